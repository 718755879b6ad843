//! What a fit tells its pages.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use hyper::body::Bytes;
use serde::Serialize;
use tokio::sync::watch;

/// The least time between two pieces of news about the progress.
const PAUSE: Duration = Duration::from_millis(250);

/// The state of the command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum State {
    /// It runs.
    #[default]
    Running,
    /// It was stopped.
    Stopped,
    /// It has done its work.
    Ended,
    /// It ended with an error.
    Failed,
}

/// A line about the progress.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct News {
    /// The step of the command.
    pub(crate) step: String,
    /// The fraction of the step that is done, 0 to 1.
    pub(crate) fraction: f64,
    /// The elapsed and the remaining time.
    pub(crate) times: String,
    /// What the step tells about itself.
    pub(crate) text: String,
}

/// What pages are told.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Told {
    pub(super) state: State,
    #[serde(flatten)]
    news: News,
    /// Whether somebody asked the command to stop.
    stops: bool,
    /// The number of the newest surface, which no surface of an earlier server has; 0 for none.
    version: u32,
}

/// What the fit left for its pages.
pub(super) struct Board {
    /// The page.
    pub(super) page: Bytes,
    pub(super) token: String,
    told: watch::Sender<Told>,
    /// The newest surface and its number.
    scene: Mutex<Option<(u32, Bytes)>>,
    /// The number of the surface that was made last.
    last_version: Mutex<u32>,
    /// When pages were told last.
    last: Mutex<Option<Instant>>,
    watchers: AtomicUsize,
    /// Connections of clients that have the token.
    guests: AtomicUsize,
    stop: Box<dyn Fn() -> bool + Send + Sync>,
}

impl Board {
    pub(super) fn new(
        page: String,
        token: String,
        first_version: u32,
        stop: Box<dyn Fn() -> bool + Send + Sync>,
    ) -> Self {
        Board {
            page: page.into(),
            token,
            told: watch::Sender::default(),
            scene: Mutex::default(),
            last_version: Mutex::new(first_version),
            last: Mutex::default(),
            watchers: AtomicUsize::new(0),
            guests: AtomicUsize::new(0),
            stop,
        }
    }

    /// What is told now, and later.
    pub(super) fn told(&self) -> watch::Receiver<Told> {
        self.told.subscribe()
    }

    pub(super) fn tell(&self, news: impl FnOnce() -> News) {
        let now = Instant::now();
        {
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_some_and(|last| now < last + PAUSE) {
                return;
            }
            *last = Some(now);
        }
        let news = news();
        self.told.send_modify(|told| told.news = news);
    }

    pub(super) fn show(&self, scene: String) {
        let version = {
            let mut last = self.last_version.lock().unwrap_or_else(PoisonError::into_inner);
            *last = last.wrapping_add(1).max(1);
            *last
        };
        *self.scene.lock().unwrap_or_else(PoisonError::into_inner) = Some((version, scene.into()));
        self.told.send_modify(|told| told.version = version);
    }

    /// The newest surface and its number.
    pub(super) fn scene(&self) -> Option<(u32, Bytes)> {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn end(&self, state: State, text: &str) {
        self.told.send_modify(|told| {
            told.state = state;
            text.clone_into(&mut told.news.text);
        });
    }

    /// Asks the command to stop. Returns whether its step can.
    pub(super) fn stop(&self) -> bool {
        let stops = (self.stop)();
        if stops {
            self.told.send_modify(|told| told.stops = true);
        }
        stops
    }

    pub(super) fn is_watched(&self) -> bool {
        self.watchers.load(Ordering::Relaxed) > 0
    }

    /// Whether a client with the token is connected.
    pub(super) fn has_guests(&self) -> bool {
        self.guests.load(Ordering::Relaxed) > 0
    }

    /// Counts a page that is open, up to the end of the value.
    pub(super) fn watcher(self: &Arc<Self>) -> Counted {
        Counted::new(self, |board| &board.watchers)
    }

    /// Counts a connection of a client that has the token, up to the end of the value.
    pub(super) fn guest(self: &Arc<Self>) -> Counted {
        Counted::new(self, |board| &board.guests)
    }
}

/// One of a number that a board counts.
pub(super) struct Counted {
    board: Arc<Board>,
    count: fn(&Board) -> &AtomicUsize,
}

impl Counted {
    fn new(board: &Arc<Board>, count: fn(&Board) -> &AtomicUsize) -> Self {
        count(board).fetch_add(1, Ordering::Relaxed);
        Counted { board: Arc::clone(board), count }
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        (self.count)(&self.board).fetch_sub(1, Ordering::Relaxed);
    }
}
