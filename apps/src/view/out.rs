//! What goes to a page from the thread that draws for it.

use axum::extract::ws::Message as Frame;
use tokio::sync::mpsc::Sender;
use tokio::sync::mpsc::error::TrySendError;

/// Messages that may wait for a slow connection; then the drawing waits.
pub(crate) const WAITING: usize = 2;

/// The way to a page; false when nobody takes what is sent.
pub(crate) struct Out(pub(crate) Sender<Frame>);

impl Out {
    /// A text, as soon as there is room for it.
    pub(crate) fn say(&self, text: String) -> bool {
        self.0.blocking_send(Frame::Text(text.into())).is_ok()
    }

    /// A picture, as soon as there is room for it.
    pub(crate) fn send(&self, picture: Vec<u8>) -> bool {
        self.0.blocking_send(Frame::Binary(picture.into())).is_ok()
    }

    /// A picture that is not finished: left out where it would have to wait.
    pub(crate) fn offer(&self, picture: Vec<u8>) -> bool {
        !matches!(self.0.try_send(Frame::Binary(picture.into())), Err(TrySendError::Closed(_)))
    }

    /// Whether a message would not have to wait.
    pub(crate) fn has_room(&self) -> bool {
        self.0.capacity() > 0
    }
}
