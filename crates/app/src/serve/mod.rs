//! The page of a fit that runs: a server for browsers, `--serve`.
//!
//! The server has a thread of its own and answers from what the fit left with it last, so that no
//! browser, and no other client, can hold the fit up. It serves four answers and no file.

mod address;
mod answers;
mod connections;
mod news;

use std::net::TcpListener;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};

pub(crate) use address::{Address, Known, THIS_COMPUTER};
use news::Board;
pub(crate) use news::{News, State};

/// A server of one page.
pub(crate) struct Site {
    known: Known,
    board: Arc<Board>,
    /// Tells the server's thread to end.
    end: Arc<tokio::sync::Notify>,
    /// Closed at the end of the server's thread.
    ended: Mutex<Receiver<()>>,
}

impl std::fmt::Debug for Site {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Site").field("address", &self.known.address).finish_non_exhaustive()
    }
}

impl Site {
    /// Starts the server of `page`. `stop` asks the command to stop, and tells whether it can.
    ///
    /// The address and the token are those of an earlier server, if `before` has some: a page that
    /// is still open goes on. Another address is taken where that one is not free.
    ///
    /// # Errors
    /// If nothing can listen at `address`.
    pub(crate) fn start(
        address: Address,
        before: Option<Known>,
        page: String,
        stop: Box<dyn Fn() -> bool + Send + Sync>,
    ) -> anyhow::Result<Self> {
        let listener = address.listen(before.as_ref().map(|known| known.address))?;
        // A run folder may come from others, who know its token.
        let before = before.filter(|known| known.address.ip().is_loopback());
        let is_for_all = !listener.local_addr()?.ip().is_loopback();
        let token = match before {
            Some(known) if !is_for_all => known.token,
            _ => address::new_token()?,
        };
        let known = Known { address: listener.local_addr()?, token };
        let version = getrandom::u32()?;
        let board = Arc::new(Board::new(page, known.token.clone(), version, stop));
        let end = Arc::new(tokio::sync::Notify::new());
        let ended = spawn(listener, Arc::clone(&board), Arc::clone(&end))?;
        Ok(Site { known, board, end, ended: Mutex::new(ended) })
    }

    /// The address of the page, with its token.
    pub(crate) fn url(&self) -> String {
        self.known.url()
    }

    /// Where the page is, for a later server of the same run.
    pub(crate) fn known(&self) -> &Known {
        &self.known
    }

    /// Whether a page is open.
    pub(crate) fn is_watched(&self) -> bool {
        self.board.is_watched()
    }

    /// Shows another surface, the JSON of the page.
    pub(crate) fn show(&self, scene: String) {
        self.board.show(scene);
    }

    /// Tells pages about the progress, now and then.
    pub(crate) fn tell(&self, news: impl FnOnce() -> News) {
        self.board.tell(news);
    }

    /// Tells pages about the end, waits until they have it, and ends the server.
    pub(crate) fn close(&self, state: State, text: &str) {
        self.board.end(state, text);
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        self.end.notify_one();
        // An error: the thread has ended.
        let _: Result<(), RecvTimeoutError> = ended.recv_timeout(2 * connections::FAREWELL);
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.end.notify_one();
    }
}

/// Runs the server on a thread of its own, until `end` and a farewell.
fn spawn(
    listener: TcpListener,
    board: Arc<Board>,
    end: Arc<tokio::sync::Notify>,
) -> anyhow::Result<Receiver<()>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    listener.set_nonblocking(true)?;
    let (ended, receiver) = channel();
    std::thread::Builder::new().name("page".to_owned()).spawn(move || {
        let _ended = ended;
        runtime.block_on(connections::serve(listener, board, end));
    })?;
    Ok(receiver)
}
