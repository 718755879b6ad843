//! The answers of the server.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use http_body_util::{Either, Full};
use hyper::body::{Body, Bytes, Frame};
use hyper::header::{self, HeaderName};
use hyper::http::response::Builder;
use hyper::{Method, Request, Response, StatusCode};
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::time::{sleep, timeout};

use super::news::{Board, Counted};

/// The body of an answer.
pub(super) type Answer = Either<Full<Bytes>, Stream>;

/// The most news a page gets: one in this time.
const PAUSE: Duration = Duration::from_millis(200);

/// News are told again after this time: a page that is gone is noticed.
const AGAIN: Duration = Duration::from_secs(10);

/// A page may load from this server, and nothing else; it may be in no frame.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
    img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The header with the number of a surface.
const VERSION: HeaderName = HeaderName::from_static("dsdf-version");

/// What an answer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// To a client without the token.
    Refused,
    /// To one with the token.
    Whole,
    /// A stream without an end.
    Endless,
}

/// The answer to a request. Its body is not read.
pub(super) fn answer<B>(request: &Request<B>, board: &Arc<Board>) -> (Response<Answer>, Kind) {
    let uri = request.uri();
    if !has_token(uri.query().unwrap_or_default(), &board.token) {
        let refused = text(StatusCode::FORBIDDEN, "the address lacks the token of the page\n");
        return (refused, Kind::Refused);
    }
    let (method, path) = (request.method(), uri.path());
    let answer = match (method, path) {
        (&Method::GET, "/") => ok("text/html; charset=utf-8", board.page.clone()),
        (&Method::GET, "/scene") => match board.scene() {
            Some((version, scene)) => {
                let answer = builder(StatusCode::OK, "application/json").header(VERSION, version);
                body(answer, scene)
            }
            None => text(StatusCode::NOT_FOUND, "there is no surface yet\n"),
        },
        (&Method::GET, "/news") => {
            let answer = builder(StatusCode::OK, "text/event-stream");
            return (whole(answer, Either::Right(Stream::of(board))), Kind::Endless);
        }
        (&Method::POST, "/stop") if board.stop() => text(StatusCode::ACCEPTED, "it stops\n"),
        (&Method::POST, "/stop") => {
            text(StatusCode::CONFLICT, "This step cannot be stopped here: press Ctrl-C there.\n")
        }
        (_, "/" | "/scene" | "/news" | "/stop") => {
            text(StatusCode::METHOD_NOT_ALLOWED, "no such method\n")
        }
        _ => text(StatusCode::NOT_FOUND, "no such page\n"),
    };
    (answer, Kind::Whole)
}

/// Whether a query has the token. It compares all digits, so that the time tells nothing.
fn has_token(query: &str, token: &str) -> bool {
    let given = query.split('&').find_map(|part| part.strip_prefix("token=")).unwrap_or_default();
    given.len() == token.len()
        && given.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

fn builder(status: StatusCode, kind: &str) -> Builder {
    Response::builder()
        .status(status)
        .header(header::CONTENT_TYPE, kind)
        .header(header::CACHE_CONTROL, "no-store")
        .header(header::X_CONTENT_TYPE_OPTIONS, "nosniff")
        .header(header::CONTENT_SECURITY_POLICY, POLICY)
        // The address has the token.
        .header(header::REFERRER_POLICY, "no-referrer")
}

fn whole(builder: Builder, body: Answer) -> Response<Answer> {
    // The values of the headers are constants and numbers, so there is no error.
    builder.body(body).unwrap_or_else(|_| Response::new(Either::Left(Full::default())))
}

fn body(builder: Builder, bytes: Bytes) -> Response<Answer> {
    whole(builder, Either::Left(Full::new(bytes)))
}

fn ok(kind: &str, bytes: Bytes) -> Response<Answer> {
    body(builder(StatusCode::OK, kind), bytes)
}

fn text(status: StatusCode, text: &'static str) -> Response<Answer> {
    body(builder(status, "text/plain; charset=utf-8"), Bytes::from_static(text.as_bytes()))
}

/// The news of a fit, as server-sent events. A client that reads slowly gets fewer of them.
pub(super) struct Stream {
    events: Receiver<Bytes>,
    _watcher: Counted,
}

impl Stream {
    fn of(board: &Arc<Board>) -> Self {
        let (sender, events) = channel(1);
        tokio::spawn(tell(Arc::clone(board), sender));
        Stream { events, _watcher: board.watcher() }
    }
}

impl Body for Stream {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let event = self.events.poll_recv(context);
        event.map(|event| event.map(|bytes| Ok(Frame::data(bytes))))
    }
}

/// Sends news until the client is gone: it closes the stream when it has the last ones.
async fn tell(board: Arc<Board>, events: Sender<Bytes>) {
    let mut news = board.told();
    loop {
        let json = serde_json::to_string(&*news.borrow_and_update());
        let Ok(json) = json else { return };
        if events.send(format!("data: {json}\n\n").into()).await.is_err() {
            return;
        }
        sleep(PAUSE).await;
        // The error of a board that is gone.
        if timeout(AGAIN, news.changed()).await.is_ok_and(|changed| changed.is_err()) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_token_opens_a_page() {
        let token = "0123456789abcdef";
        let open = ["token=0123456789abcdef", "a=b&token=0123456789abcdef"];
        assert!(open.iter().all(|query| has_token(query, token)));
        for query in ["", "token=", "token", "token=0123456789abcde", "token=0123456789abcdeg"] {
            assert!(!has_token(query, token), "{query}");
        }
        // The first one counts.
        assert!(!has_token("token=x&token=0123456789abcdef", token));
    }
}
