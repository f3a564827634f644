//! What all connected pages look at, and how the training behind it goes.

use super::scene::Scene3d;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::sync::watch;

/// What is shown.
#[derive(Clone)]
pub(crate) enum Shown {
    /// Nothing yet, and why.
    Waiting {
        /// What is waited for.
        title: String,
        /// A sentence for the person.
        message: String,
    },
    /// A scene.
    Scene(Arc<dyn Scene3d>),
}

impl Shown {
    /// What is sent to the page.
    pub(crate) fn text(&self) -> String {
        match self {
            Self::Waiting { title, message } => {
                json!({ "type": "waiting", "title": title, "message": message }).to_string()
            }
            Self::Scene(scene) => {
                let mut text = serde_json::to_value(scene.describe()).unwrap_or_default();
                text["type"] = Value::from("scene");
                text.to_string()
            }
        }
    }

    pub(crate) fn scene(&self) -> Option<&Arc<dyn Scene3d>> {
        match self {
            Self::Waiting { .. } => None,
            Self::Scene(scene) => Some(scene),
        }
    }
}

/// What is shown, for everybody who watches.
pub(crate) struct Stage {
    shown: watch::Sender<Shown>,
    /// The message `training`; empty where nothing is known of any training.
    training: watch::Sender<Arc<str>>,
    /// The message `fast`; empty where nothing stands for the scene.
    fast: watch::Sender<Arc<str>>,
}

/// Ends of [`Stage`] for one who watches: what is shown, the training, the cloud that stands for a field.
pub(crate) type Watch = (watch::Receiver<Shown>, watch::Receiver<Arc<str>>, watch::Receiver<Arc<str>>);

impl Stage {
    pub(crate) fn new(shown: Shown) -> Self {
        let fast = shown.scene().map(|scene| scene.fast_message()).unwrap_or_default();
        Self {
            shown: watch::Sender::new(shown),
            training: watch::Sender::new("".into()),
            fast: watch::Sender::new(fast.into()),
        }
    }

    pub(crate) fn show(&self, shown: Shown) {
        let fast = shown.scene().map(|scene| scene.fast_message()).unwrap_or_default();
        self.shown.send_replace(shown);
        self.tell_fast(&fast);
    }

    pub(crate) fn tell(&self, training: &str) {
        replace(&self.training, training);
    }

    /// There is something to say of the cloud that stands for a field.
    pub(crate) fn tell_fast(&self, message: &str) {
        replace(&self.fast, message);
    }

    /// Whether anybody looks.
    pub(crate) fn is_watched(&self) -> bool {
        self.shown.receiver_count() > 0
    }

    pub(crate) fn watch(&self) -> Watch {
        (self.shown.subscribe(), self.training.subscribe(), self.fast.subscribe())
    }
}

/// A message in the place of another, where it is another.
fn replace(place: &watch::Sender<Arc<str>>, message: &str) {
    place.send_if_modified(|old| {
        let is_news = old.as_ref() != message;
        if is_news {
            *old = message.into();
        }
        is_news
    });
}
