//! A cloud and the part of it that a crop leaves: the newest crop's part is kept, so that a camera that moves finds it again.

use engine::crop::CropBox;
use engine::crop::{Crop, Traits};
use serde::Serialize;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use systems::splats::Cloud;

/// Share of what shows that the sliders' box holds, at both ends of each axis.
const ENDS: f64 = 0.01;

/// A cloud that can be cropped.
pub(crate) struct Cropped {
    whole: Arc<Cloud>,
    /// Of the whole, world units; measured when first asked for.
    traits: OnceLock<Traits>,
    part: Mutex<Option<(Crop, Arc<Cloud>)>>,
}

/// Where the sliders of a crop begin and end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Hints {
    /// What most of the cloud lies in, with some room.
    #[serde(rename = "box")]
    pub(crate) bounds: CropBox,
    /// Standard deviations, world units: that of the middle Gaussian and the largest.
    pub(crate) large: [f64; 2],
    /// Distances to neighbours, world units: the same.
    pub(crate) alone: [f64; 2],
    /// Gaussians.
    pub(crate) count: usize,
}

impl Cropped {
    pub(crate) fn new(cloud: Cloud) -> Self {
        Self { whole: Arc::new(cloud), traits: OnceLock::new(), part: Mutex::new(None) }
    }

    pub(crate) fn whole(&self) -> &Cloud {
        &self.whole
    }

    /// What `crop` leaves.
    pub(crate) fn part(&self, crop: &Crop) -> Arc<Cloud> {
        if crop.keeps_everything() {
            return self.whole.clone();
        }
        let mut kept = self.part.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, part)) = kept.as_ref()
            && of == crop
        {
            return part.clone();
        }
        let traits = self.traits();
        let all = self.whole.gaussians();
        let part = Arc::new(self.whole.part(|i| crop.keeps(&all, traits, i)));
        *kept = Some((crop.clone(), part.clone()));
        part
    }

    fn traits(&self) -> &Traits {
        self.traits.get_or_init(|| Traits::of(&self.whole.gaussians()))
    }

    /// Where sliders begin and end.
    pub(crate) fn hints(&self) -> Hints {
        let traits = self.traits();
        let all = self.whole.gaussians();
        let n = all.len();
        let at = |mut values: Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values.get(((values.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(0.0)
        };
        let shown: Vec<usize> = (0..n).filter(|&i| traits.opacity[i] > 0.1).collect();
        let [mut least, mut most] = [[0.0; 3], [1.0; 3]];
        for (k, (least, most)) in least.iter_mut().zip(&mut most).enumerate() {
            let along = || shown.iter().map(|&i| f64::from(all.mean[k * n + i])).collect::<Vec<f64>>();
            let (low, high) = (at(along(), ENDS), at(along(), 1.0 - ENDS));
            let room = ((high - low) * 0.05).max(1e-6);
            (*least, *most) = (low - room, high + room);
        }
        let bounds: CropBox = [least, most];
        let range = |values: &[f32]| {
            let of = |share| at(values.iter().map(|x| f64::from(*x)).filter(|x| x.is_finite()).collect(), share);
            let (middle, most) = (of(0.5).max(1e-9), of(1.0));
            [middle, most.max(2.0 * middle)]
        };
        Hints { bounds, large: range(&traits.size), alone: range(&traits.apart), count: n }
    }
}
