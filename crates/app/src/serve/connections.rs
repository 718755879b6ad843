//! The connections of the server, and their limits.

use std::convert::Infallible;
use std::future::ready;
use std::net::TcpListener;
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpStream;
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, sleep, timeout};

use super::answers::{Kind, answer};
use super::news::Board;

/// How long the server stays after the end, for pages that are open: they load the last surface, and
/// close their connections.
pub(super) const FAREWELL: Duration = Duration::from_secs(5);

/// The most connections at a time; more are closed at once. A process may have 1024 files.
const MOST_CONNECTIONS: usize = 128;

/// How long a client may take for the head of its request.
const HEAD: Duration = Duration::from_secs(5);

/// How long a client may take for all but the news.
const WHOLE: Duration = Duration::from_secs(60);

/// The largest head of a request: bytes, and fields.
const HEAD_BYTES: usize = 16 << 10;
const HEAD_FIELDS: usize = 64;

/// Serves until `end`, and then up to [`FAREWELL`], as long as a page is open.
pub(super) async fn serve(listener: TcpListener, board: Arc<Board>, end: Arc<Notify>) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let free = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let accepting = tokio::spawn(accept(listener, Arc::clone(&board), free));
    end.notified().await;
    let last = Instant::now() + FAREWELL;
    while board.has_guests() && Instant::now() < last {
        sleep(Duration::from_millis(20)).await;
    }
    accepting.abort();
}

async fn accept(listener: tokio::net::TcpListener, board: Arc<Board>, free: Arc<Semaphore>) {
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // The system has no room: for a moment, there are no new connections.
            sleep(Duration::from_millis(100)).await;
            continue;
        };
        if let Ok(permit) = Arc::clone(&free).try_acquire_owned() {
            tokio::spawn(connection(stream, Arc::clone(&board), permit));
        }
    }
}

/// Answers one request.
async fn connection(stream: TcpStream, board: Arc<Board>, _permit: OwnedSemaphorePermit) {
    let (is_stream, guest) = (AtomicBool::new(false), Mutex::new(None));
    let service = service_fn(|request| {
        let (answer, kind) = answer(&request, &board);
        is_stream.store(kind == Kind::Endless, Ordering::Relaxed);
        if kind != Kind::Refused {
            *guest.lock().unwrap_or_else(PoisonError::into_inner) = Some(board.guest());
        }
        ready(Ok::<_, Infallible>(answer))
    });
    let mut serving = pin!(
        http1::Builder::new()
            .keep_alive(false)
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD)
            .max_headers(HEAD_FIELDS)
            .max_buf_size(HEAD_BYTES)
            .serve_connection(TokioIo::new(stream), service)
    );
    // An error is a client that is gone, or no client of HTTP.
    if timeout(WHOLE, &mut serving).await.is_err() && is_stream.load(Ordering::Relaxed) {
        let _ = serving.await;
    }
}
