//! Pipelines that something needs and that are not there yet, so that another thread can make them first.

use super::Device;
use super::graveyard::lock;
use super::pipeline::Pipeline;
use super::recipe::Recipe;
use crate::error::Result;
use std::cell::RefCell;

thread_local! {
    /// What is missing, while `Device::missing` looks for it on this thread.
    static FOUND: RefCell<Option<Vec<Recipe>>> = const { RefCell::new(None) };
}

/// Pipelines that are not there yet.
pub struct Missing(Vec<Recipe>);

impl Missing {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Ends the search, also after a panic.
struct Search;

impl Drop for Search {
    fn drop(&mut self) {
        FOUND.take();
    }
}

impl Device {
    /// Finds the pipelines that `make` needs and that are not there yet, without making them. What `make` returns has
    /// other pipelines in their places, and is dropped; it must not use them.
    ///
    /// # Errors
    /// Fails if `make` fails.
    pub fn missing<T>(&self, make: impl FnOnce() -> Result<T>) -> Result<Missing> {
        FOUND.set(Some(Vec::new()));
        let _search = Search;
        drop(make()?);
        Ok(Missing(FOUND.take().unwrap_or_default()))
    }

    /// Makes pipelines. They are kept for whoever asks for them next.
    ///
    /// # Errors
    /// Fails if the driver rejects a shader.
    pub fn make(&self, missing: Missing) -> Result<()> {
        missing.0.into_iter().try_for_each(|recipe| self.kept(recipe).map(drop))
    }

    /// While this thread looks for missing pipelines: notes one, and returns another in its place, if there is any.
    pub(super) fn stand_in(&self, recipe: &Recipe) -> Option<Pipeline> {
        FOUND.with_borrow_mut(|found| {
            let found = found.as_mut()?;
            let other = lock(&self.pipelines).any()?;
            if !found.contains(recipe) {
                found.push(recipe.clone());
            }
            Some(other)
        })
    }
}
