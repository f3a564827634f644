//! A deformation from its settings: which networks see what, and what they begin with.

use super::config::{DeformConfig, Moment, Motion, PlanesOfTime, SeenBy, Sees};
use super::moments::{Moments, TimeNetwork};
use super::times::Times;
use super::{Deform, pass, refuse};
use crate::networks::parts;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::planes::Planes;
use field_core::init::Init;
use field_core::mlp::{Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};

/// Stream of the initial parameters.
const INIT: u64 = 0x6465_666f;
/// Largest number the last layer of a warp begins with: points start where they are.
const SMALL: f32 = 1e-4;
/// Codes begin in `0..CODE` (Nerfies).
const CODE: f32 = 0.05;

fn octaves(dims: usize, octaves: usize, identity: Identity) -> Result<Frequency, SystemError> {
    Frequency::new(dims, octaves, Base::One, identity).map_err(refuse)
}

/// Factors that begin small in space and at 1 in time: a product that does not depend on time yet (K-Planes, section 3.2).
fn init_planes(planes: &Planes, rng: &Rng, params: &mut [f32]) {
    for (k, pair) in planes.pairs().enumerate() {
        let params = &mut params[planes.plane_range(k)];
        if pair.contains(&3) {
            params.fill(1.0);
        } else {
            rng.substream(k as u64).fill_uniform(0, params);
            params.iter_mut().for_each(|p| *p = 0.1 + 0.4 * *p);
        }
    }
}

fn new_planes(config: &PlanesOfTime) -> Result<Vec<Planes>, SystemError> {
    let of = |&cells: &usize| {
        let r = [cells, cells, cells, config.times].map(|r| r.min(1 << 16) as u32);
        Planes::k_planes(r, config.features).map_err(refuse)
    };
    config.cells.iter().map(of).collect()
}

/// Hidden layers with a skip of the input into the fifth, where there are so many.
fn network(inputs: usize, (depth, width): (usize, usize), outputs: usize) -> Result<Mlp, SystemError> {
    let skips = if depth > 4 { vec![4] } else { vec![] };
    Mlp::new(&MlpConfig::new(inputs, vec![width; depth], outputs).with_skips(skips)).map_err(refuse)
}

impl Deform {
    /// A deformation that moves nothing yet, for training views of these times.
    pub(super) fn of_times(config: DeformConfig, times: Times, seed: u64) -> Result<Self, SystemError> {
        let simd = Simd::best();
        let dims = Self::moment_dims(config.moment);
        let rng = Rng::new(seed, INIT);
        let (time_octaves, code_len) = match config.moment {
            Moment::Time { octaves } => (octaves, 0),
            Moment::TimeNetwork { octaves, .. } => (octaves, 0),
            Moment::Codes { dims } => (0, dims * times.len()),
        };
        let time = octaves(1, time_octaves, Identity::Include)?;
        let mut codes = vec![0.0; code_len];
        let mut time_network = None;
        if let Moment::TimeNetwork { width, .. } = config.moment {
            let mlp = network(time.out_rows(), (1, width), dims)?;
            codes = vec![0.0; mlp.param_count()];
            parts::init([&mlp], Init::XavierUniform, rng.substream(0), &mut codes);
            time_network = Some(TimeNetwork { mlp, packed: Packed::default() });
        } else {
            rng.substream(0).fill_uniform(0, &mut codes);
            codes.iter_mut().for_each(|c| *c *= CODE);
        }
        let encoding = |n: Option<usize>, dims, identity| n.map(|n| octaves(dims, n, identity)).transpose();
        let warp_point = encoding(config.warp.as_ref().map(|w| w.octaves), 3, Identity::Include)?;
        let ambient_point = encoding(config.ambient.map(|a| a.octaves), 3, Identity::Omit)?;
        let seen = match config.sees {
            Sees::MomentAndPoint { octaves } => Some(octaves),
            Sees::Place | Sees::Moment => None,
        };
        let seen_point = encoding(seen, 3, Identity::Include)?;
        let ambients = config.ambient.map_or(1, |a| a.dims);
        // Without the coordinates themselves, which no window closes: before they come in they say nothing.
        let seen_ambient = encoding(config.ambient.map(|a| a.seen_octaves), ambients, Identity::Omit)?;
        let rows = |f: &Option<Frequency>| f.as_ref().map_or(0, Frequency::out_rows);
        let planes = config.planes.as_ref().map_or(Ok(Vec::new()), new_planes)?;
        let leads = config.planes.as_ref().is_some_and(|p| p.seen_by != SeenBy::Density);
        let plane_rows: usize = planes.iter().map(Planes::features).filter(|_| leads).sum();
        let warp = config.warp.as_ref().map(|w| {
            let outputs = if w.motion == Motion::Rigid { 6 } else { 3 };
            network(rows(&warp_point) + dims + plane_rows, (w.depth, w.width), outputs)
        });
        let ambient = config.ambient.map(|a| network(rows(&ambient_point) + dims, (a.depth, a.width), a.dims));
        let (warp, ambient) = (warp.transpose()?, ambient.transpose()?);
        let count = |mlp: &Option<Mlp>| mlp.as_ref().map_or(0, Mlp::param_count);
        let (warps, all) = (count(&warp), count(&warp) + count(&ambient));
        let plane_params: usize = planes.iter().map(Planes::params_len).sum();
        let mut params = vec![0.0; all + plane_params];
        let mut at = all;
        for (k, planes) in planes.iter().enumerate() {
            init_planes(planes, &rng.substream(8 + k as u64), &mut params[at..]);
            at += planes.params_len();
        }
        let places = [(&warp, 0..warps), (&ambient, warps..all)];
        for (k, (mlp, range)) in places.into_iter().enumerate() {
            let Some(mlp) = mlp else { continue };
            let (rng, params) = (rng.substream(1 + k as u64), &mut params[range]);
            parts::init([mlp], Init::XavierUniform, rng, params);
            // Points begin where they are.
            if let Some(last) = mlp.layers().last() {
                rng.substream(u64::MAX).fill_uniform(0, &mut params[last.weights.clone()]);
                params[last.weights.clone()].iter_mut().for_each(|w| *w *= SMALL);
            }
        }
        let mut deform = Self {
            adam: Adam::new(all, AdamConfig::DEFAULT),
            plane_adam: Adam::new(plane_params, AdamConfig::DEFAULT),
            plane_start: all,
            grad: vec![0.0; all + plane_params],
            planes,
            code_adam: Adam::new(codes.len(), AdamConfig::DEFAULT),
            code_grad: vec![0.0; codes.len()],
            packed: Default::default(),
            moments: Moments::default(),
            steps: 0,
            warp_window: vec![0.0; config.warp.as_ref().map_or(0, |w| w.octaves)],
            ambient_window: vec![0.0; config.ambient.map_or(0, |a| a.seen_octaves)],
            counts: pass::Counts::default(),
            order: times.in_order(),
            still_points: Vec::new(),
            config,
            simd,
            times,
            time,
            time_network,
            warp_point,
            ambient_point,
            seen_point,
            seen_ambient,
            warp,
            ambient,
            params,
            codes,
        };
        deform.renew();
        Ok(deform)
    }
}
