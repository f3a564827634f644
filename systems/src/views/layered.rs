//! Pictures of two clouds that are drawn one by one and put together.

use super::drawing::Projections;
use super::front::{CloudLayers, Front, FrontSeen, ViewLayers};
use super::photo::view;
use super::render::{Buffers, CloudRenderer};
use super::skipped::Skipped;
use engine::system::{Behind, Layers, Query};
use render_core::camera::Camera;
use splat_core::{Raster, SplatError, View};

/// Masks of a Gaussian in front.
const MASKS: usize = 3;
/// From this share of a pixel on its depth is that of the front.
const HALF: f32 = 0.5;

impl CloudRenderer<'_> {
    /// What a pinhole camera sees of both, or of the one behind alone.
    pub(super) fn layered(
        &self,
        of: &ViewLayers,
        camera: &Camera,
        query: &Query,
        buffers: &mut Buffers,
    ) -> Result<(Layers, Skipped), SplatError> {
        let alone = CloudRenderer { layers: None, ..*self };
        let behind = CloudRenderer { clouds: self.clouds.get(..1).unwrap_or(&[]), ..alone };
        let (mut layers, mut skipped) = behind.pinhole(camera, query, buffers)?;
        if query.layers.behind == Behind::Compute {
            layers.behind = layers.rgb.clone();
        }
        let shown = self.clouds.get(1..2).filter(|front| of.front == Front::Shown && !front[0].gaussians.is_empty());
        let Some(clouds) = shown else { return Ok((layers, skipped)) };
        let front = CloudRenderer { clouds, ..alone };
        let over_nothing = Query { background: [0.0; 3], ..query.clone() };
        let (seen, more) = front.pinhole(camera, &over_nothing, buffers)?;
        skipped.add(&more);
        let masks = front.masks(&*of.part, &view(camera, self.frame), &buffers.projections)?;
        put_together(&*of.part, &mut layers, &seen, &masks);
        Ok((layers, skipped))
    }

    /// `[masks][pixels]` of the cloud in front, composited over nothing.
    fn masks(&self, part: &dyn CloudLayers, view: &View, projections: &Projections) -> Result<Vec<f32>, SplatError> {
        let mut features = Vec::with_capacity(projections.gaussians().len());
        for ((_, projection), cloud) in projections.each().zip(self.clouds) {
            let n = cloud.gaussians.len();
            features.extend(projection.gaussians.iter().map(|f| part.masks(cloud.extra, n, f.index as usize)));
        }
        let mut raster = Raster::<MASKS>::default();
        raster.draw(self.simd, projections.gaussians(), &features, view.size, &self.settings)?;
        let mut planes = vec![0.0; (MASKS + 1) * view.size[0] * view.size[1]];
        raster.planes(&mut planes)?;
        planes.truncate(MASKS * view.size[0] * view.size[1]);
        Ok(planes)
    }
}

/// Put what is in front before what is behind, in the place of the latter.
fn put_together(part: &dyn CloudLayers, behind: &mut Layers, front: &Layers, masks: &[f32]) {
    let n = behind.rgb.len();
    for i in 0..n {
        let masks = [0, 1, 2].map(|k| masks[k * n + i]);
        let pixel = FrontSeen { colour: front.rgb[i], masks, transmittance: 1.0 - front.opacity[i] };
        let (rgb, share) = part.pixel(&pixel, behind.rgb[i]);
        behind.rgb[i] = rgb;
        behind.opacity[i] = share + (1.0 - share) * behind.opacity[i];
        if share > HALF {
            behind.depth[i] = front.depth[i];
            behind.median_depth[i] = front.median_depth[i];
            if let (Some(to), Some(from)) = (behind.normal.get_mut(i), front.normal.get(i)) {
                *to = *from;
            }
            if let (Some(to), Some(from)) = (behind.canonical.get_mut(i), front.canonical.get(i)) {
                *to = *from;
            }
        }
    }
}
