//! Web client: one page in the browser that shows a running session and gives it orders, and one that parts a splat by
//! strokes.
//!
//! In reading order: `feed` reads the session, `latest` keeps what pages need of it, `packing` makes a Gaussian small.
//! `guard` says who may ask, `places` how many, `http` answers, `commands` passes orders on; `strokes` is the other page. The
//! pages themselves are in `src/page`, as `files` has them served: plain HTML, CSS and JavaScript with WebGL2.

mod commands;
mod feed;
mod files;
mod guard;
mod http;
mod latest;
pub mod packing;
mod places;
pub mod strokes;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use cosplat_ipc::{Client, Domain, client::ConnectError};
use serde_json::Value;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};

pub use commands::Materials;

use crate::commands::Orders;
use crate::feed::Shared;
use crate::guard::Guard;
use crate::http::Site;

/// What to serve, and where.
pub struct Options {
    /// Domain of the session.
    pub domain: Domain,
    /// Name of the session.
    pub session: String,
    /// How long to wait for its server, and for answers to orders.
    pub patience: Duration,
    /// Where to listen; port 0 for a free one.
    pub address: SocketAddr,
    /// Whether orders are refused.
    pub read_only: bool,
    /// Materials to choose from, an array of objects with `name`, `law` and the keys of a scene file.
    pub presets: Value,
    /// What makes a material of words.
    pub materials: Materials,
}

/// Why the page is not served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// No server, or none that we understand.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The address is in use, or not of this machine.
    #[error("cannot listen on {address}: {cause}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// No threads, or no random numbers.
    #[error("cannot begin to serve the page: {cause}")]
    System {
        /// The system's reason.
        cause: std::io::Error,
    },
}

/// Where a page listens, and who may ask there.
pub struct Door {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    guard: Guard,
}

impl Door {
    fn open(address: SocketAddr) -> Result<Door, WebError> {
        let system = |cause| WebError::System { cause };
        let mut runtime = Builder::new_current_thread();
        let runtime = runtime.enable_all().build().map_err(system)?;
        let listener = runtime.block_on(TcpListener::bind(address));
        let listener = listener.map_err(|cause| WebError::Listen { address, cause })?;
        let address = listener.local_addr().map_err(system)?;
        Ok(Door {
            guard: Guard::new(address).map_err(system)?,
            runtime,
            listener,
            address,
        })
    }

    /// The link that opens the page. The token is in its fragment, which browsers keep to themselves.
    pub fn link(&self) -> String {
        format!("http://{}/#{}", self.address, self.guard.token())
    }

    /// Whether only this machine reaches the page.
    pub fn is_local(&self) -> bool {
        guard::is_local(self.address.ip())
    }
}

/// A page that waits for browsers.
pub struct Server {
    options: Options,
    door: Door,
    client: Client,
}

impl Server {
    /// Attaches to the session and listens.
    ///
    /// # Errors
    /// When there is no such session within `options.patience`, or the address cannot be had.
    pub fn bind(options: Options) -> Result<Server, WebError> {
        let client = connect(&options, options.patience)?;
        Ok(Server {
            door: Door::open(options.address)?,
            options,
            client,
        })
    }

    /// Where it listens.
    pub fn door(&self) -> &Door {
        &self.door
    }

    /// Serves until `stop`. The session may end and come back meanwhile.
    pub fn run(self, stop: &AtomicBool) {
        let shared = Shared::new();
        let options = &self.options;
        let (orders, waiting) = Orders::new();
        let Door {
            runtime,
            listener,
            guard,
            ..
        } = self.door;
        let site = Arc::new(Site {
            shared: shared.clone(),
            orders: (!options.read_only).then_some(orders),
            presets: options.presets.clone(),
            guard,
            board: None,
        });
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let again = || connect(options, Duration::ZERO);
                feed::run(&shared, self.client, again, &is_over);
            });
            let (domain, session) = (&options.domain, &options.session);
            let (patience, materials) = (options.patience, &options.materials);
            scope.spawn(move || commands::run(&waiting, domain, session, patience, materials));
            runtime.block_on(http::serve(listener, site, stop));
            // Ends connections, and with the last of them the thread of the orders.
            runtime.shutdown_background();
            is_over.store(true, Ordering::Relaxed);
        });
    }
}

fn connect(options: &Options, patience: Duration) -> Result<Client, ConnectError> {
    Client::connect(&options.domain, &options.session, "web", patience)
}
