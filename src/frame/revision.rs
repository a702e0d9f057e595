//! Revision numbers identify contents: a stage runs if its inputs are newer than its result. A stage gives the same
//! bits for the same inputs, so a skipped stage never shows an outdated state.

use std::sync::atomic::{AtomicU64, Ordering};

/// A number that no content of any scene has had before.
pub(super) fn new_revision() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// Revision of a stage's result, with the revisions of the inputs it was made from.
#[derive(Debug, Default)]
pub(super) struct Made {
    from: Vec<u64>,
    revision: u64,
}

impl Made {
    /// Records the inputs of the next result. Returns whether they differ from those of the current result, or there is
    /// none yet.
    pub(super) fn renew(&mut self, from: impl IntoIterator<Item = u64> + Clone) -> bool {
        let same = self.revision != 0 && self.from.iter().copied().eq(from.clone());
        if !same {
            self.from.clear();
            self.from.extend(from);
            self.revision = new_revision();
        }
        !same
    }

    /// Revision of the result.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }
}

/// A value and its revision.
#[derive(Debug)]
pub(super) struct Watched<T> {
    value: Option<T>,
    revision: u64,
}

impl<T> Default for Watched<T> {
    fn default() -> Self {
        Self { value: None, revision: 0 }
    }
}

impl<T: PartialEq + Copy> Watched<T> {
    /// Returns the value's revision. It is a new one if the value differs from the last call's.
    pub(super) fn revision_of(&mut self, value: T) -> u64 {
        if self.value != Some(value) {
            (self.value, self.revision) = (Some(value), new_revision());
        }
        self.revision
    }

    /// Revision of the last value.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }
}
