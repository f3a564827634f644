//! The server: one page, and one WebSocket that the page talks to. Nothing else is served.

use super::connections::{Patience, serve};
use super::guard::{Guard, Refusal};
use super::page::Page;
use super::protocol::LARGEST_MESSAGE;
use super::seat::Seat;
use super::session::talk;
use super::stage::Stage;
use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Pages that may be open at a time: each has a thread that draws.
const MOST_PAGES: usize = 8;

/// Bytes that may wait for a page that does not read: more than the largest picture has. Answers to pings are among them.
const MOST_WAITING: usize = 64 << 20;

/// What requests are answered with.
#[derive(Clone)]
struct Shared {
    guard: Arc<Guard>,
    page: Arc<Page>,
    stage: Arc<Stage>,
    pages: Arc<AtomicUsize>,
    patience: Patience,
}

/// A place to listen at, and who is let in.
pub(crate) struct Server {
    listener: TcpListener,
    /// Where it listens.
    pub(crate) address: SocketAddr,
    guard: Guard,
}

impl Server {
    /// Take a port; 0 is any that is free.
    ///
    /// # Errors
    /// What the system says: a port in use, a name that is not known.
    pub(crate) fn bind(host: &str, port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((host.trim_matches(['[', ']']), port))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let guard = Guard::new(host, address.ip());
        Ok(Self { listener, address, guard })
    }

    /// Serve until `interrupt` is raised.
    ///
    /// # Errors
    /// What the system says.
    pub(crate) fn run(self, stage: Arc<Stage>, patience: Patience, interrupt: &AtomicBool) -> io::Result<()> {
        const LOOK_UP: Duration = Duration::from_millis(100);
        let shared = Shared {
            guard: Arc::new(self.guard),
            page: Arc::new(Page::new()),
            stage,
            pages: Arc::new(AtomicUsize::new(0)),
            patience,
        };
        let router = Router::new()
            .route("/", get(page))
            .route("/live", get(live))
            .layer(from_fn_with_state(shared.clone(), guarded))
            .with_state(shared);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(self.listener)?;
            let raised = async {
                while !interrupt.load(Ordering::Relaxed) {
                    tokio::time::sleep(LOOK_UP).await;
                }
            };
            tokio::select! {
                () = serve(listener, router, patience) => {}
                () = raised => {}
            }
            Ok(())
        })
    }
}

/// Refuse what is foreign, and say on every answer what browsers may do with it.
async fn guarded(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let judged = shared.guard.judge(request.uri(), request.headers());
    let csp = shared.page.policy(judged.as_deref().unwrap_or_default());
    let mut answer = match judged {
        Ok(_) => next.run(request).await,
        Err(refusal) => refused(refusal),
    };
    let is_upgrade = answer.status() == StatusCode::SWITCHING_PROTOCOLS;
    let headers = answer.headers_mut();
    if !is_upgrade {
        // One request a connection: nothing that comes after it is read.
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if let Ok(csp) = HeaderValue::from_str(&csp) {
        headers.insert(header::CONTENT_SECURITY_POLICY, csp);
    }
    answer
}

fn refused(refusal: Refusal) -> Response {
    let status = match refusal {
        Refusal::Host | Refusal::Origin => StatusCode::FORBIDDEN,
        Refusal::Twice(_) => StatusCode::BAD_REQUEST,
        Refusal::Body => StatusCode::PAYLOAD_TOO_LARGE,
    };
    (status, format!("{}: {}\n", status.as_u16(), refusal.text())).into_response()
}

async fn page(State(shared): State<Shared>) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    (headers, shared.page.text.clone()).into_response()
}

async fn live(State(shared): State<Shared>, upgrade: WebSocketUpgrade) -> Response {
    let Some(seat) = Seat::take(&shared.pages, MOST_PAGES) else {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("503: {MOST_PAGES} pages are open already; close one\n"))
            .into_response();
    };
    upgrade
        .max_message_size(LARGEST_MESSAGE)
        .max_frame_size(LARGEST_MESSAGE)
        .max_write_buffer_size(MOST_WAITING)
        .on_upgrade(move |socket| talk(socket, shared.stage, shared.patience.page, seat))
}
