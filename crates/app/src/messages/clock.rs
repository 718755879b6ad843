//! When the next line of progress is due.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Seconds between two lines.
const EVERY: u64 = 10;

/// The time of the next line of a command, whatever step it is in.
#[derive(Clone, Debug)]
pub(crate) struct Clock {
    start: Instant,
    /// The time of the next line, in seconds from the start.
    next: Arc<AtomicU64>,
}

impl Default for Clock {
    fn default() -> Self {
        Clock { start: Instant::now(), next: Arc::new(AtomicU64::new(EVERY)) }
    }
}

impl Clock {
    /// The time since the command's start.
    pub(crate) fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// True if a line is due at this time after the start. Of several threads that ask at the same
    /// time, one gets true.
    pub(crate) fn is_due(&self, elapsed: Duration) -> bool {
        let (seconds, next) = (elapsed.as_secs(), self.next.load(Ordering::Relaxed));
        let after = seconds + EVERY;
        seconds >= next
            && self.next.compare_exchange(next, after, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_due_every_ten_seconds_and_once() {
        let lines = Clock::default();
        let due: Vec<u64> =
            (0..35).filter(|second| lines.is_due(Duration::from_secs(*second))).collect();
        assert_eq!(due, [10, 20, 30]);
        assert!(!lines.is_due(Duration::from_secs(35)));
        // After a long step, the next line is ten seconds later again.
        assert!(lines.is_due(Duration::from_secs(99)) && !lines.is_due(Duration::from_secs(108)));
    }
}
