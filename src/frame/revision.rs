//! Which content a thing has, as a number: a stage runs if what it reads is newer than what it made. Nothing of one moment
//! is ever shown at another, since a stage gives the same bits for the same inputs.

use std::sync::atomic::{AtomicU64, Ordering};

/// A number that no content has had, in any scene.
pub(super) fn new_revision() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// What a stage has made, by what it was made of.
#[derive(Debug, Default)]
pub(super) struct Made {
    from: Vec<u64>,
    revision: u64,
}

impl Made {
    /// Takes note that it is about to be of these inputs; says whether it is of others, or of nothing, until now.
    pub(super) fn renew(&mut self, from: impl IntoIterator<Item = u64> + Clone) -> bool {
        let same = self.revision != 0 && self.from.iter().copied().eq(from.clone());
        if !same {
            self.from.clear();
            self.from.extend(from);
            self.revision = new_revision();
        }
        !same
    }

    /// Which content it is.
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
    /// Revision of a value: a new one unless it is that of last time.
    pub(super) fn revision_of(&mut self, value: T) -> u64 {
        if self.value != Some(value) {
            (self.value, self.revision) = (Some(value), new_revision());
        }
        self.revision
    }

    /// Revision of the value of last time.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }
}
