//! The server: one page, and one WebSocket that the page talks to. Nothing else is served.

use super::guard::{Guard, Refusal};
use super::page::Page;
use super::protocol::LARGEST_MESSAGE;
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

/// What requests are answered with.
#[derive(Clone)]
struct Shared {
    guard: Arc<Guard>,
    page: Arc<Page>,
    stage: Arc<Stage>,
    pages: Arc<AtomicUsize>,
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
    pub(crate) fn run(self, stage: Arc<Stage>, interrupt: &AtomicBool) -> io::Result<()> {
        const LOOK_UP: Duration = Duration::from_millis(100);
        let shared = Shared {
            guard: Arc::new(self.guard),
            page: Arc::new(Page::new()),
            stage,
            pages: Arc::new(AtomicUsize::new(0)),
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
                served = axum::serve(listener, router) => served,
                () = raised => Ok(()),
            }
        })
    }
}

/// Refuse what is foreign, and say on every answer what browsers may do with it.
async fn guarded(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let (judged, csp) = judge(&shared, request.headers());
    let mut answer = match judged {
        Ok(()) => next.run(request).await,
        Err(refusal) => refused(refusal),
    };
    let headers = answer.headers_mut();
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

/// Whether a request is ours, and the policy of the page under the name it was asked for by.
fn judge(shared: &Shared, headers: &HeaderMap) -> (Result<(), Refusal>, String) {
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    // A request that names several hosts names none.
    let one_host = headers.get_all(header::HOST).iter().count() == 1;
    let host = text(header::HOST).filter(|_| one_host);
    let judged = shared.guard.check(host, text(header::ORIGIN));
    (judged, shared.page.policy(host.filter(|_| judged.is_ok()).unwrap_or_default()))
}

fn refused(refusal: Refusal) -> Response {
    (StatusCode::FORBIDDEN, refusal.text()).into_response()
}

async fn page(State(shared): State<Shared>) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    (headers, shared.page.text.clone()).into_response()
}

async fn live(State(shared): State<Shared>, upgrade: WebSocketUpgrade) -> Response {
    let seat = Seat(shared.pages);
    if seat.0.fetch_add(1, Ordering::Relaxed) >= MOST_PAGES {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("503: {MOST_PAGES} pages are open already; close one\n"))
            .into_response();
    }
    upgrade.max_message_size(LARGEST_MESSAGE).max_frame_size(LARGEST_MESSAGE).on_upgrade(async move |socket| {
        talk(socket, shared.stage).await;
        drop(seat);
    })
}

/// The place of a page among [`MOST_PAGES`]; free again when dropped, whatever happened.
struct Seat(Arc<AtomicUsize>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
