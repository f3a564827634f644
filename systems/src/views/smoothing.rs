//! The 3D filter of the clouds of a training: nothing is drawn smaller than what photos show.

use super::cloud::TrainedCloud;
use super::cloud_frame::CloudFrame;
use super::cloud_parameters::CloudParameters;
use super::config::PictureConfig;
use super::photo::view;
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorData, TensorMap, f32_tensor};
use float_core::Simd;
use splat_core::{Gaussians, Smoothed, SmoothingFilter, SplatError, View};

/// Steps between two measurements of the filters, besides those after Gaussians came and went.
const EVERY: u64 = 100;

/// The filters of the clouds of a picture.
#[derive(Clone, Debug)]
pub(super) struct Smoothing {
    filter: SmoothingFilter,
    /// Cameras of the photos, of the frame of training.
    views: Vec<View>,
    /// Standard deviations of the filters of each cloud's Gaussians, internal units.
    sizes: Vec<Vec<f32>>,
    smoothed: Vec<Smoothed>,
}

impl Smoothing {
    /// For clouds at their start; `None` where the settings want no filter.
    ///
    /// # Errors
    /// [`SplatError`] for cameras that cannot see.
    pub(super) fn new(
        pictures: &PictureConfig,
        data: &Dataset,
        frame: &CloudFrame,
        clouds: &[TrainedCloud],
    ) -> Result<Option<Self>, SplatError> {
        if pictures.smoothing == 0.0 {
            return Ok(None);
        }
        let mut new = Self {
            filter: SmoothingFilter::DEFAULT.with_variance(pictures.smoothing).with_near(pictures.near),
            views: data.views().iter().map(|seen| view(&seen.camera, frame)).collect(),
            sizes: vec![Vec::new(); clouds.len()],
            smoothed: vec![Smoothed::default(); clouds.len()],
        };
        clouds.iter().enumerate().try_for_each(|(index, cloud)| new.measure(index, &cloud.parameters.gaussians))?;
        Ok(Some(new))
    }

    /// Whether filters are measured after `steps` steps, though no Gaussian came or went.
    pub(super) fn is_due(steps: u64) -> bool {
        steps.is_multiple_of(EVERY)
    }

    /// Measure the filters of cloud number `index` anew.
    pub(super) fn measure(&mut self, index: usize, cloud: &Gaussians) -> Result<(), SplatError> {
        self.sizes[index] = self.filter.sizes(cloud, &self.views)?;
        Ok(())
    }

    /// Standard deviations of the filters of cloud number `index`, internal units.
    #[cfg(test)]
    pub(super) fn sizes(&self, index: usize) -> &[f32] {
        &self.sizes[index]
    }

    /// Filter all clouds. [`restore`](Self::restore) makes them what they were.
    pub(super) fn apply<'a>(
        &mut self,
        simd: Simd,
        clouds: impl Iterator<Item = &'a mut CloudParameters>,
    ) -> Result<(), SplatError> {
        let mut all: Vec<&mut CloudParameters> = clouds.collect();
        for ((cloud, sizes), smoothed) in all.iter().zip(&self.sizes).zip(&mut self.smoothed) {
            smoothed.smooth(simd, &cloud.gaussians, sizes)?;
        }
        self.restore(all.iter_mut().map(|cloud| &mut **cloud));
        Ok(())
    }

    /// Exchange clouds with what they are after the filter, or were before it.
    pub(super) fn restore<'a>(&mut self, clouds: impl Iterator<Item = &'a mut CloudParameters>) {
        for (cloud, smoothed) in clouds.zip(&mut self.smoothed) {
            smoothed.exchange(&mut cloud.gaussians);
        }
    }

    /// Backward twin of [`apply`](Self::apply): cloud number `index` as it was before, and the gradient with respect to what was drawn, which
    /// becomes that with respect to it.
    pub(super) fn pull_back(
        &self,
        simd: Simd,
        index: usize,
        cloud: &CloudParameters,
        bar: &mut CloudParameters,
    ) -> Result<(), SplatError> {
        Smoothed::backward(simd, &cloud.gaussians, &self.sizes[index], &mut bar.gaussians)
    }

    /// Cloud number `index`, filtered.
    pub(super) fn filtered(&self, simd: Simd, index: usize, mut cloud: Gaussians) -> Gaussians {
        let mut smoothed = Smoothed::default();
        // Filters are those of as many Gaussians.
        if smoothed.smooth(simd, &cloud, &self.sizes[index]).is_ok() {
            smoothed.exchange(&mut cloud);
        }
        cloud
    }

    /// What the next picture depends on.
    pub(super) fn state(&self) -> impl Iterator<Item = Tensor<'_>> {
        self.sizes.iter().enumerate().map(|(index, sizes)| f32_tensor(name(index), sizes))
    }

    /// Read the filters that [`state`](Self::state) wrote: a number for each Gaussian of each cloud.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(super) fn take(&self, state: &TensorMap, clouds: &[TrainedCloud]) -> Result<Vec<Vec<f32>>, SystemError> {
        clouds
            .iter()
            .enumerate()
            .map(|(index, cloud)| match state.get(&name(index)).map(|tensor| &tensor.data) {
                Some(TensorData::F32(sizes))
                    if sizes.len() == cloud.parameters.len() && sizes.iter().all(|size| *size >= 0.0) =>
                {
                    Ok(sizes.to_vec())
                }
                _ => {
                    Err(SystemError::State { name: name(index), problem: "a filter for each Gaussian expected".into() })
                }
            })
            .collect()
    }

    /// Put what [`take`](Self::take) gave in its place.
    pub(super) fn put(&mut self, sizes: Vec<Vec<f32>>) {
        self.sizes = sizes;
    }
}

/// Name in checkpoints.
fn name(index: usize) -> String {
    format!("splats.filter{index}")
}
