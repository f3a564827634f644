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
    /// What the page is told.
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
}

impl Stage {
    pub(crate) fn new(shown: Shown) -> Self {
        Self { shown: watch::Sender::new(shown), training: watch::Sender::new("".into()) }
    }

    pub(crate) fn show(&self, shown: Shown) {
        self.shown.send_replace(shown);
    }

    pub(crate) fn tell(&self, training: &str) {
        self.training.send_if_modified(|old| {
            let is_news = old.as_ref() != training;
            if is_news {
                *old = training.into();
            }
            is_news
        });
    }

    /// Whether anybody looks.
    pub(crate) fn is_watched(&self) -> bool {
        self.shown.receiver_count() > 0
    }

    pub(crate) fn watch(&self) -> (watch::Receiver<Shown>, watch::Receiver<Arc<str>>) {
        (self.shown.subscribe(), self.training.subscribe())
    }
}
