//! The server of the page: what is asked for, and the limits of asking.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use cosplat_ipc::monotonic_ns;
use http_body_util::{BodyExt, LengthLimitError, Limited};
use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::header::{self, HeaderName, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;
use tokio_io_timeout::TimeoutStream;

use crate::commands::{Ordered, Orders, Unsent};
use crate::feed::Shared;
use crate::files;
use crate::guard::Guard;
use crate::latest::{Known, Parts};
use crate::places::{KNOWN, Place, Places};
use crate::strokes::{Asked, Board};

/// Longest head of a request [byte], the least that the library can limit it to.
const HEAD: usize = 8192;
/// Longest order [byte].
const ORDER: usize = 4096;
/// Longest body with strokes [byte].
const STROKES: usize = 1 << 20;
/// How long a head, and then a body, may take, and how long the other end may take nothing of an answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long a request for what is newer waits.
const POLL: Duration = Duration::from_millis(250);
/// How often the stop flag is looked at.
const GLANCE: Duration = Duration::from_millis(100);

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

type Answer = Response<Parts>;

impl Body for Parts {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        Poll::Ready(self.0.pop_front().map(|part| Ok(Frame::data(part))))
    }

    fn is_end_stream(&self) -> bool {
        self.0.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.len() as u64)
    }
}

/// What answers are made of.
pub struct Site {
    /// The session.
    pub shared: Arc<Shared>,
    /// Where orders go; none of a server that only shows.
    pub orders: Option<Orders>,
    /// Materials to choose from.
    pub presets: Value,
    /// Who may ask.
    pub guard: Guard,
    /// What makes objects of strokes, where that is the page.
    pub board: Option<Arc<Board>>,
}

/// Answers requests until `stop`.
pub async fn serve(listener: TcpListener, site: Arc<Site>, stop: &AtomicBool) {
    let places = Arc::new(Places::default());
    while !stop.load(Ordering::Relaxed) {
        match timeout(GLANCE, listener.accept()).await {
            Ok(Ok((stream, _))) => {
                let place = places.enter();
                let id = place.id();
                let task = tokio::spawn(connection(stream, site.clone(), Arc::new(place)));
                places.keep(id, task.abort_handle());
            }
            Ok(Err(error)) => {
                // Out of descriptors, mostly: those of other connections come back.
                tracing::debug!(%error, "a connection is not taken");
                tokio::time::sleep(GLANCE).await;
            }
            Err(_) => {}
        }
    }
}

async fn connection(stream: TcpStream, site: Arc<Site>, place: Arc<Place>) {
    // Frames are whole: nothing is gained by waiting for more to send.
    let _ = stream.set_nodelay(true);
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(PATIENCE));
    let service = service_fn(|request: Request<Incoming>| {
        let (site, place) = (site.clone(), place.clone());
        async move {
            let has_no_body = *request.method() == Method::HEAD;
            let mut answer = site.answer(&place, request).await;
            if has_no_body {
                *answer.body_mut() = Parts::default();
            }
            Ok::<_, Infallible>(answer)
        }
    });
    let served = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .max_buf_size(HEAD)
        .serve_connection(TokioIo::new(Box::pin(stream)), service)
        .await;
    if let Err(error) = served {
        tracing::debug!(%error, "a connection ended");
    }
}

impl Site {
    async fn answer(&self, place: &Place, request: Request<Incoming>) -> Answer {
        place.heard();
        let (method, path) = (request.method(), request.uri().path());
        if let Err((status, why)) = self.guard.admit(method, request.headers()) {
            return refusal(status, why);
        }
        if let Some((_, kind, text)) = files::find(path, self.board.is_some()) {
            return match *method {
                Method::GET => file(kind, text),
                _ => refusal(StatusCode::METHOD_NOT_ALLOWED, "the page is only read"),
            };
        }
        if !self.guard.knows_token(request.headers()) {
            let why = "the token is missing or wrong: open the link that the server printed";
            return refusal(StatusCode::UNAUTHORIZED, why);
        }
        if !place.shows_token() {
            let why = format!("{KNOWN} connections are open already");
            let mut answer = refusal(StatusCode::TOO_MANY_REQUESTS, &why);
            let close = HeaderValue::from_static("close");
            answer.headers_mut().insert(header::CONNECTION, close);
            return answer;
        }
        match (method, path) {
            (&Method::GET, "/scene") => self.scene(),
            (&Method::GET, "/harmonics") => binary(whole(self.shared.latest().harmonics())),
            (&Method::GET, "/frame") => match known(request.uri().query().unwrap_or_default()) {
                Some(known) => self.frame(known).await,
                None => refusal(
                    StatusCode::BAD_REQUEST,
                    "expected scene=N&version=N&figures=N with numbers from 0",
                ),
            },
            (_, "/scene" | "/harmonics" | "/frame") => other_method(),
            (method, path) => match (&self.board, method, path) {
                (Some(board), &Method::POST, "/strokes") => {
                    strokes(board.clone(), request.into_body()).await
                }
                (None, &Method::POST, "/command") => self.command(request.into_body()).await,
                (Some(_), _, "/strokes") | (None, _, "/command") => other_method(),
                _ => refusal(StatusCode::NOT_FOUND, "no such page"),
            },
        }
    }

    fn scene(&self) -> Answer {
        // So that frames are read by the time that the page asks for one.
        drop(self.shared.ask());
        let mut about = self.shared.latest().about();
        about["presets"] = self.presets.clone();
        about["read_only"] = self.orders.is_none().into();
        json(StatusCode::OK, &about)
    }

    /// What is newer than what a page has, as soon as there is any; the figures alone after a while without.
    async fn frame(&self, known: Known) -> Answer {
        let mut news = self.shared.ask();
        let newer = timeout(POLL, async {
            loop {
                news.borrow_and_update();
                if let Some(answer) = self.shared.latest().answer(known, monotonic_ns()) {
                    return answer;
                }
                if news.changed().await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
        });
        match newer.await {
            Ok(answer) => binary(answer),
            Err(_) => binary(self.shared.latest().nothing_new(known, monotonic_ns())),
        }
    }

    async fn command(&self, body: Incoming) -> Answer {
        let Some(orders) = &self.orders else {
            let why = "this server only shows (--read-only): it takes no orders";
            return refusal(StatusCode::FORBIDDEN, why);
        };
        let ordered: Ordered = match read(body, ORDER, "an order").await {
            Ok(ordered) => ordered,
            Err((status, why)) => return refusal(status, &why),
        };
        match orders.hand_in(ordered) {
            Ok(answer) => match answer.await {
                Ok(answer) => json(StatusCode::OK, &answer),
                Err(_) => refusal(StatusCode::SERVICE_UNAVAILABLE, &Unsent::Ended.to_string()),
            },
            Err(error @ Unsent::Full) => refusal(StatusCode::TOO_MANY_REQUESTS, &error.to_string()),
            Err(error) => refusal(StatusCode::SERVICE_UNAVAILABLE, &error.to_string()),
        }
    }
}

/// The objects of a page's strokes. Whoever makes them takes a while: other requests are answered meanwhile.
async fn strokes(board: Arc<Board>, body: Incoming) -> Answer {
    let asked: Asked = match read(body, STROKES, "strokes").await {
        Ok(asked) => asked,
        Err((status, why)) => return refusal(status, &why),
    };
    match tokio::task::spawn_blocking(move || board.answer(asked)).await {
        Ok(Ok(answer)) => binary(answer),
        Ok(Err(why)) => refusal(StatusCode::UNPROCESSABLE_ENTITY, &why),
        Err(error) => refusal(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// What a body says, which has at most so many bytes; the error is status and reason of the answer.
async fn read<T: DeserializeOwned>(
    body: Incoming,
    most: usize,
    what: &str,
) -> Result<T, (StatusCode, String)> {
    let whole = timeout(PATIENCE, Limited::new(body, most).collect()).await;
    let text = match whole {
        Err(_) => return Err((StatusCode::REQUEST_TIMEOUT, format!("{what} did not come"))),
        Ok(Err(error)) if error.is::<LengthLimitError>() => {
            let why = format!("{what} may have at most {most} bytes");
            return Err((StatusCode::PAYLOAD_TOO_LARGE, why));
        }
        Ok(Err(error)) => return Err((StatusCode::BAD_REQUEST, error.to_string())),
        Ok(Ok(body)) => body.to_bytes(),
    };
    serde_json::from_slice(&text).map_err(|error| (StatusCode::BAD_REQUEST, error.to_string()))
}

fn other_method() -> Answer {
    refusal(StatusCode::METHOD_NOT_ALLOWED, "the other of GET and POST")
}

/// What a page says that it has.
fn known(query: &str) -> Option<Known> {
    let mut known = Known::default();
    for pair in query.split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=')?;
        match key {
            "scene" => known.scene = value.parse().ok()?,
            "version" => known.version = value.parse().ok()?,
            "figures" => known.figures = Some(value.parse().ok()?),
            _ => return None,
        }
    }
    Some(known)
}

fn whole(bytes: impl Into<Bytes>) -> Parts {
    Parts([bytes.into()].into())
}

fn answer(status: StatusCode, kind: &'static str, body: Parts) -> Answer {
    let mut answer = Response::new(body);
    *answer.status_mut() = status;
    let fixed: [(HeaderName, &'static str); 5] = [
        (header::CONTENT_TYPE, kind),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-store"),
        (header::REFERRER_POLICY, "no-referrer"),
        (
            HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
    ];
    for (name, value) in fixed {
        let value = HeaderValue::from_static(value);
        answer.headers_mut().insert(name, value);
    }
    answer
}

fn file(kind: &'static str, text: &'static str) -> Answer {
    let mut answer = answer(StatusCode::OK, kind, whole(text));
    let policy = HeaderValue::from_static(POLICY);
    let headers = answer.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    answer
}

fn binary(parts: Parts) -> Answer {
    answer(StatusCode::OK, "application/octet-stream", parts)
}

fn json(status: StatusCode, value: &Value) -> Answer {
    answer(status, "application/json", whole(value.to_string()))
}

fn refusal(status: StatusCode, why: &str) -> Answer {
    json(status, &serde_json::json!({ "refused": why }))
}

#[cfg(test)]
mod tests;
