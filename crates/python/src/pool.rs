//! Threads after a fork.

use std::process::id;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

/// The process whose threads are rayon's own; 0 before the first call.
static FIRST: AtomicU32 = AtomicU32::new(0);

/// The threads of a process that was forked from it.
static FORKED: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs parallel work. A fork copies the memory of a process and none of its threads: work in a
/// child would wait for the threads of its parent for ever, so a child gets threads of its own.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let process = id();
    let first = FIRST.compare_exchange(0, process, Ordering::SeqCst, Ordering::SeqCst);
    if first.is_ok() || first == Err(process) {
        return work();
    }
    let pool = {
        let mut forked = FORKED.lock().unwrap_or_else(PoisonError::into_inner);
        match forked.take().filter(|(owner, _)| *owner == process) {
            Some((_, pool)) => Some(pool),
            None => ThreadPoolBuilder::new().build().ok().map(Arc::new),
        }
        .inspect(|pool| *forked = Some((process, Arc::clone(pool))))
    };
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}
