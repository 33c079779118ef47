//! Which messages are the server's: those of the node that holds `hello`.

use std::{fmt::Debug, sync::Arc};

use iceoryx2::{
    identifiers::{UniqueNodeId, UniquePublisherId},
    prelude::{CallbackProgression, PortFactory, ZeroCopySend},
};

use crate::session::{HelloService, PubSub};

/// Tells the server's publisher on a stream from others.
pub(super) struct Origin<T: Debug + ZeroCopySend + 'static, H: Debug + ZeroCopySend + 'static> {
    hello: Arc<HelloService>,
    stream: PubSub<T, H>,
    /// The server may be gone when its messages are read.
    believed: Option<UniquePublisherId>,
    ignored: Option<UniquePublisherId>,
}

impl<T: Debug + ZeroCopySend, H: Debug + ZeroCopySend> Origin<T, H> {
    pub fn new(hello: Arc<HelloService>, stream: PubSub<T, H>) -> Self {
        let mut origin = Self {
            hello,
            stream,
            believed: None,
            ignored: None,
        };
        let server = origin.server();
        origin.believed = server.and_then(|server| origin.find(|_, node| node == server));
        origin
    }

    /// The service.
    pub fn stream(&self) -> &PubSub<T, H> {
        &self.stream
    }

    /// Whether `publisher` is that of the server, of now or of when a message of it was last believed.
    pub fn is_servers(&mut self, publisher: UniquePublisherId) -> bool {
        if self.believed == Some(publisher) {
            return true;
        }
        let server = self.server();
        let found = self.find(|id, node| id == publisher && Some(node) == server);
        if found.is_some() {
            self.believed = found;
            return true;
        }
        let is_there = self.find(|id, _| id == publisher).is_some();
        if is_there && self.ignored.replace(publisher) != Some(publisher) {
            let service = self.stream.name();
            tracing::warn!(%service, "ignoring a publisher that is not the server's");
        }
        false
    }

    /// The node that serves the session; `hello` takes no second publisher.
    fn server(&self) -> Option<UniqueNodeId> {
        let mut server = None;
        self.hello.dynamic_config().list_publishers(|publisher| {
            server = Some(publisher.node_id);
            CallbackProgression::Stop
        });
        server
    }

    /// The first publisher on the stream that is `wanted`.
    fn find(
        &self,
        wanted: impl Fn(UniquePublisherId, UniqueNodeId) -> bool,
    ) -> Option<UniquePublisherId> {
        let mut found = None;
        self.stream.dynamic_config().list_publishers(|publisher| {
            if !wanted(publisher.publisher_id, publisher.node_id) {
                return CallbackProgression::Continue;
            }
            found = Some(publisher.publisher_id);
            CallbackProgression::Stop
        });
        found
    }
}
