//! Working memory that a call leaves for later calls.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Mutex;

/// Values that no call uses. Several threads may take them. A clone has none.
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Pool(Mutex::new(Vec::new()))
    }
}

impl<T> Clone for Pool<T> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl<T> fmt::Debug for Pool<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool").finish_non_exhaustive()
    }
}

impl<T: Default> Pool<T> {
    /// A value that an earlier call has left as it was, or else a new one.
    pub(crate) fn take(&self, new: impl FnOnce() -> T) -> Taken<'_, T> {
        let left = self.0.lock().ok().and_then(|mut left| left.pop());
        Taken { value: left.unwrap_or_else(new), pool: self }
    }
}

/// A value of a pool, which goes back when it is dropped.
pub(crate) struct Taken<'a, T: Default> {
    value: T,
    pool: &'a Pool<T>,
}

impl<T: Default> Deref for Taken<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T: Default> DerefMut for Taken<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value
    }
}

impl<T: Default> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        // A panic while another thread held the lock costs this value, and nothing else.
        if let Ok(mut left) = self.pool.0.lock() {
            left.push(std::mem::take(&mut self.value));
        }
    }
}
