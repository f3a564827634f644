//! Connections: each is one request, answered within a time, and there is a bound to how many are open.
//!
//! | what | bound |
//! | --- | --- |
//! | a request and its answer, from the first byte to the last | [`Patience::request`], then the connection is closed |
//! | requests on a connection | one, as every answer says `Connection: close`; or a WebSocket is what becomes of it |
//! | connections that wait for a request or its answer | [`MOST_OPEN`]; the oldest makes room for the newest |
//! | bytes of a request before its body | [`LARGEST_HEAD`] in at most [`MOST_HEADERS`] headers |
//!
//! The oldest makes room, and not the newest: a request of a browser is whole within milliseconds, and a flood of half ones would
//! have to be as quick to push it out. Addresses are not counted: on one machine all are the same.

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use std::collections::VecDeque;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::AbortHandle;
use tokio::time::{sleep, timeout};

/// Connections that are not yet a WebSocket.
const MOST_OPEN: usize = 64;

/// Bytes of the request line and the headers: those of browsers have a few hundred.
const LARGEST_HEAD: usize = 16 << 10;

/// Headers of a request: browsers send about fifteen.
const MOST_HEADERS: usize = 64;

/// After the system could give no connection (too many open files), before it is asked again.
const RETRY: Duration = Duration::from_millis(100);

/// How long others may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Patience {
    /// A request and its answer.
    pub(crate) request: Duration,
    /// A page without a sign of life, and one message to it.
    pub(crate) page: Duration,
}

impl Patience {
    /// A request has ten seconds, or less where a page has less.
    pub(crate) fn new(page: Duration) -> Self {
        Self { request: page.min(Duration::from_secs(10)), page }
    }
}

/// Answer all who connect; never ends by itself. Connections end when this future is dropped with its runtime.
pub(crate) async fn serve(listener: TcpListener, router: Router, patience: Patience) {
    let service = TowerToHyperService::new(router);
    let mut http = http1::Builder::new();
    http.max_buf_size(LARGEST_HEAD).max_headers(MOST_HEADERS);
    let mut open: VecDeque<AbortHandle> = VecDeque::with_capacity(MOST_OPEN);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(RETRY).await;
            continue;
        };
        open.retain(|task| !task.is_finished());
        if open.len() >= MOST_OPEN
            && let Some(oldest) = open.pop_front()
        {
            oldest.abort();
        }
        let connection = http.serve_connection(TokioIo::new(stream), service.clone()).with_upgrades();
        open.push_back(tokio::spawn(timeout(patience.request, connection)).abort_handle());
    }
}
