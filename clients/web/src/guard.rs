//! Who may ask: any web site that a user visits can reach this server, and a name that it owns may be made to point here.
//! A request is looked at here before it is routed.

use std::net::{IpAddr, SocketAddr};

use hyper::header::{HOST, HeaderMap, HeaderName, ORIGIN};
use hyper::{Method, StatusCode};

/// Header in which a page shows the token.
pub const TOKEN: HeaderName = HeaderName::from_static("x-cosplat-token");
const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// What requests have to show.
#[derive(Clone, Debug)]
pub struct Guard {
    address: SocketAddr,
    token: String,
}

impl Guard {
    /// A guard of the server at `address`, with a new token of 128 random bits.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn new(address: SocketAddr) -> std::io::Result<Guard> {
        use std::io::Read;
        let mut bytes = [0; 16];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Guard { address, token })
    }

    /// The token, 32 hexadecimal digits.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Whether a request may be routed at all; the error is the answer.
    ///
    /// # Errors
    /// A status of 4xx, with a sentence.
    pub fn admit(&self, method: &Method, head: &HeaderMap) -> Result<(), (StatusCode, &str)> {
        let forbidden = |why| Err((StatusCode::FORBIDDEN, why));
        let host = match only(head, &HOST) {
            Ok(Some(host)) if self.is_ours(host) => host,
            _ => return forbidden("the host is not this server"),
        };
        match only(head, &ORIGIN) {
            Ok(None) => {}
            Ok(Some(origin)) if origin.strip_prefix("http://") == Some(host) => {}
            _ => return forbidden("the origin is another site"),
        }
        match only(head, &FETCH_SITE) {
            Ok(None | Some("same-origin" | "none")) => {}
            _ => return forbidden("the request comes from another site"),
        }
        match *method {
            Method::GET | Method::POST => Ok(()),
            Method::OPTIONS => {
                forbidden("no site is allowed what this server does not do by itself")
            }
            _ => Err((
                StatusCode::METHOD_NOT_ALLOWED,
                "only GET and POST are known",
            )),
        }
    }

    /// Whether a request shows the token.
    pub fn knows_token(&self, head: &HeaderMap) -> bool {
        let shown = only(head, &TOKEN).ok().flatten().unwrap_or_default();
        let shown = shown.as_bytes();
        let own = self.token.as_bytes();
        // All bytes, so that time says nothing of how many are right.
        let differs = shown.iter().zip(own).fold(0, |all, (a, b)| all | (a ^ b));
        shown.len() == own.len() && differs == 0
    }

    fn is_ours(&self, host: &str) -> bool {
        let port = self.address.port();
        if host == format!("localhost:{port}") {
            return true;
        }
        let Ok(address) = host.parse::<SocketAddr>() else {
            return false;
        };
        let ip = self.address.ip();
        // An address is no name that could be made to point elsewhere.
        let is_known = address.ip().is_loopback() || address.ip() == ip || ip.is_unspecified();
        address.port() == port && is_known
    }
}

/// Several headers, or no text, where one value is needed: another reader of the request may take another of them.
struct Unclear;

/// The value of a header that a request has once or not at all.
fn only<'h>(head: &'h HeaderMap, name: &HeaderName) -> Result<Option<&'h str>, Unclear> {
    let mut values = head.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| Unclear),
        (Some(_), Some(_)) => Err(Unclear),
    }
}

/// Whether only this machine reaches an address.
pub fn is_local(address: IpAddr) -> bool {
    address.is_loopback()
}
