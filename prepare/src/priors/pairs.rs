//! Flow between pairs of photos, each pair once.

use super::exact::Exact;
use crate::error::PrepareError;
use crate::flow::flow_both_ways;
use render_core::camera::Camera;
use scene_io::{Flow, ImageStore};
use std::sync::Arc;

/// Pairs that are kept: the one to the photo before and the one to the next.
const KEPT: usize = 2;

/// Flow between photos, found when it is asked for.
pub(super) struct Pairs<'a> {
    photos: &'a ImageStore,
    /// Knows flow exactly, where the scene is drawn; `None`: it is found by comparing photos.
    exact: Option<Exact<'a>>,
    kept: Vec<Pair>,
}

/// Both flows of a pair.
#[derive(Clone)]
pub(super) struct Pair {
    from: usize,
    to: usize,
    flows: Arc<[Flow; 2]>,
}

impl Pair {
    /// From the earlier photo to the later one.
    pub(super) fn forward(&self) -> &Flow {
        &self.flows[0]
    }

    /// From the later photo to the earlier one.
    pub(super) fn backward(&self) -> &Flow {
        &self.flows[1]
    }
}

impl<'a> Pairs<'a> {
    pub(super) fn new(photos: &'a ImageStore, exact: Option<Exact<'a>>) -> Self {
        Self { photos, exact, kept: Vec::new() }
    }

    /// The drawn scene, where there is one.
    pub(super) fn exact(&self) -> Option<Exact<'a>> {
        self.exact
    }

    /// The camera of a photo, at the size of its flow.
    pub(super) fn camera(&self, photo: usize) -> &'a Camera {
        self.photos.camera(photo)
    }

    /// The flow between two photos of one size: indices of the store.
    pub(super) fn get(&mut self, from: usize, to: usize) -> Result<Pair, PrepareError> {
        if let Some(known) = self.kept.iter().find(|pair| (pair.from, pair.to) == (from, to)) {
            return Ok(known.clone());
        }
        let flows = match &self.exact {
            Some(exact) => exact.flows(from, to)?,
            None => flow_both_ways(&*self.photos.get(from)?, &*self.photos.get(to)?),
        };
        let pair = Pair { from, to, flows: Arc::new(flows) };
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        self.kept.push(pair.clone());
        Ok(pair)
    }
}
