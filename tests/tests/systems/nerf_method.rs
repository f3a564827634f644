//! The published networks with a photo model: codes for each photo, a transient part, and the photo model's own loss.

use engine::data::{Batch, Dataset, Patches, Shape};
use engine::options::Background;
use engine::render::plain_query;
use engine::system::{
    Appearance, Fit, LayerRequest, Layers, Normals, Query, System, SystemError, Tensor, TensorData, TensorMap,
    f32_tensor, take_f32,
};
use render_core::ray::Ray;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Split, StoreOptions};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use systems::networks::{NetworkConfig, RaysConfig, Recipe, TwoLevel, TwoLevelConfig};
use systems::papers::static_scenes::mip_nerf::MipNerfConfig;
use systems::papers::static_scenes::nerf::NerfConfig;
use systems::photo_model::{Codes, Drawing, Outcome, PhotoAndRender, PhotoModel, Pixel, PixelBar};
use systems::space::{Space, SpaceKind};

/// Length of an appearance and of a transient code.
const DIMS: [usize; 2] = [3, 2];
const VIEWS: usize = 5;
/// Least uncertainty, and factor of the transient density.
const BETA_MIN: f32 = 0.2;
const SPARSE: f32 = 0.03;

/// What the photo model of these tests was told.
#[derive(Default)]
struct Told {
    /// Loss of each pixel of the last step: coarse level, fine level.
    losses: [BTreeMap<usize, f32>; 2],
    /// Each pixel's part in the mean, its view and what was rendered.
    share: f32,
    weight: Vec<f32>,
    views: Vec<u32>,
    pixels: Vec<Pixel>,
    bars: [Vec<f32>; 2],
    judged: Vec<Pixel>,
    surveyed: Vec<(usize, usize)>,
    shown: Vec<Pixel>,
}

/// The loss of NeRF in the Wild with codes that follow their gradient.
struct Both {
    rows: [Vec<f32>; 2],
    drawing: Drawing,
    survey_before: Option<u64>,
    with: [bool; 2],
    told: Arc<Mutex<Told>>,
}

impl Both {
    fn new() -> Self {
        let row = |dims: usize, phase: f32| (0..VIEWS * dims).map(|i| (phase + 1.7 * i as f32).sin()).collect();
        Self {
            rows: [row(DIMS[0], 0.3), row(DIMS[1], 2.0)],
            drawing: Drawing::Pixels,
            survey_before: None,
            with: [true; 2],
            told: Arc::default(),
        }
    }

    fn codes(&self, which: usize) -> Option<Codes<'_>> {
        self.with[which].then_some(Codes { dims: DIMS[which], rows: &self.rows[which] })
    }
}

impl PhotoModel for Both {
    fn name(&self) -> &'static str {
        "both"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.codes(0)
    }

    fn transient(&self) -> Option<Codes<'_>> {
        self.codes(1)
    }

    fn drawing(&self) -> Drawing {
        self.drawing
    }

    fn judges_batch(&self, step: u64) -> bool {
        step % 2 == 1
    }

    fn judge(&mut self, batch: &Batch, _step: u64, pixels: &[Pixel], truth: &[[f32; 3]]) {
        assert_eq!((pixels.len(), truth.len()), (batch.len(), batch.len()));
        self.told.lock().unwrap().judged = pixels.to_vec();
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let e = [0, 1, 2].map(|c| pixel.rgb[c] - truth[c]);
        let squared = e.iter().map(|e| e * e).sum::<f32>() / 3.0;
        let beta = BETA_MIN + pixel.beta;
        let loss = squared / (2.0 * beta * beta) + beta.ln() + SPARSE * pixel.sigma_t;
        self.told.lock().unwrap().losses[1].insert(i, loss);
        let bar = PixelBar {
            rgb: e.map(|e| e / (3.0 * beta * beta)),
            beta: 1.0 / beta - squared / beta.powi(3),
            sigma_t: SPARSE,
        };
        (loss, bar)
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let e = [0, 1, 2].map(|c| rgb[c] - truth[c]);
        let loss = e.iter().map(|e| e * e).sum::<f32>() / 6.0;
        self.told.lock().unwrap().losses[0].insert(i, loss);
        (loss, e.map(|e| e / 3.0))
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let bars = [outcome.appearance_bar, outcome.transient_bar];
        for which in [0, 1] {
            let bars = bars[which].chunks_exact(DIMS[which]);
            for (bars, &view) in bars.zip(&outcome.batch.view) {
                let at = view as usize * DIMS[which];
                for (value, bar) in self.rows[which][at..].iter_mut().zip(bars) {
                    *value -= bar;
                }
            }
        }
        let told = &mut *self.told.lock().unwrap();
        (told.share, told.weight) = (outcome.share, outcome.batch.weight.clone());
        (told.views, told.pixels) = (outcome.batch.view.clone(), outcome.pixels.to_vec());
        told.bars = bars.map(<[f32]>::to_vec);
        0
    }

    fn survey(&self, step: u64) -> Option<u32> {
        (self.survey_before == Some(step)).then_some(1)
    }

    fn begins_anew(&self) -> Option<u64> {
        self.survey_before
    }

    fn survey_view(&mut self, _data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        self.told.lock().unwrap().surveyed.push((seen.view, seen.pixels.len()));
        Ok(())
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        self.told.lock().unwrap().shown = seen.pixels.to_vec();
        Some(seen.pixels.iter().map(|p| 1.0 - p.transient).collect())
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        vec![f32_tensor("both.appearance", &self.rows[0]), f32_tensor("both.transient", &self.rows[1])]
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.rows[0] = take_f32(state, "both.appearance", self.rows[0].len())?;
        self.rows[1] = take_f32(state, "both.transient", self.rows[1].len())?;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.rows.iter().map(Vec::len).sum()
    }
}

fn data(size: u32) -> Dataset {
    let options =
        TabletopOptions { width: size, height: size, train: VIEWS, test: 1, rays: 1, ..TabletopOptions::default() };
    let scene = tabletop(&options);
    let store = StoreOptions::default().with_budget_bytes(1 << 30);
    let store = Arc::new(ImageStore::new(&scene.frames, store).unwrap());
    Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap()
}

/// Small networks, few samples, few rays.
fn narrow(levels: TwoLevelConfig) -> TwoLevelConfig {
    let network = NetworkConfig { width: 24, depth: 3, position_octaves: 4, direction_octaves: 2, ..levels.network };
    TwoLevelConfig { network, rays: RaysConfig { coarse: 12, fine: 10, batch_rays: 48, ..levels.rays }, ..levels }
}

fn small() -> NerfConfig {
    let mut config = NerfConfig::published(SpaceKind::Box);
    config.levels = narrow(config.levels);
    config.training.lr = 2e-3;
    config
}

fn small_cones() -> MipNerfConfig {
    let published = MipNerfConfig::published(SpaceKind::Box);
    MipNerfConfig { levels: narrow(published.levels), ..published }
}

fn system<R: Recipe>(config: R, photo_model: Both) -> TwoLevel<R> {
    let space = Space::boxed(glam::DVec3::ZERO, 1.6, 0.05);
    TwoLevel::with_photo_model(config, space, Background::White, 7, Some(Box::new(photo_model))).unwrap()
}

/// Loss of the first step's batch, and the gradient of each code of both kinds, summed over the pixels of its view.
fn first_step<R: Recipe>(config: &R, data: &Dataset, rows: &[Vec<f32>; 2]) -> (f64, [Vec<f64>; 2]) {
    let photo_model = Both { rows: rows.clone(), ..Both::new() };
    let told = photo_model.told.clone();
    system(config.clone(), photo_model).step(data, 0).unwrap();
    let told = told.lock().unwrap();
    let factors = [0, 1].map(|level| f64::from(config.level_weight(level)));
    let mut loss = 0.0;
    for (losses, factor) in told.losses.iter().zip(factors) {
        assert!(!losses.is_empty());
        let each = losses.iter().map(|(&i, &loss)| f64::from(told.weight[i]) * f64::from(loss));
        loss += factor * f64::from(told.share) * each.sum::<f64>();
    }
    let mut bars = [0, 1].map(|which| vec![0.0; VIEWS * DIMS[which]]);
    for which in [0, 1] {
        assert_eq!(told.bars[which].len(), told.views.len() * DIMS[which]);
        for (bar, &view) in told.bars[which].chunks_exact(DIMS[which]).zip(&told.views) {
            for (sum, &bar) in bars[which][view as usize * DIMS[which]..].iter_mut().zip(bar) {
                *sum += f64::from(bar);
            }
        }
    }
    (loss, bars)
}

fn codes_follow_their_gradient<R: Recipe>(config: &R) {
    let data = data(8);
    let rows = Both::new().rows;
    let (_, bars) = first_step(config, &data, &rows);
    for which in [0, 1] {
        const H: f32 = 2e-3;
        let gradients: Vec<f64> = (0..rows[which].len())
            .map(|k| {
                let [up, down] = [H, -H].map(|h| {
                    let mut rows = rows.clone();
                    rows[which][k] += h;
                    first_step(config, &data, &rows).0
                });
                (up - down) / (2.0 * f64::from(H))
            })
            .collect();
        let length = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
        let want = length(&mut gradients.iter().copied());
        let off = length(&mut gradients.iter().zip(&bars[which]).map(|(a, b)| a - b));
        // Differences of f32 losses, over kinks of the networks.
        assert!(want > 1e-5 && off < 4e-2 * want, "codes {which}: {:?}, differences {gradients:?}", bars[which]);
    }
}

#[test]
fn gradients_of_codes_match_differences_of_the_loss() {
    codes_follow_their_gradient(&small());
}

#[test]
fn gradients_of_codes_match_differences_of_the_loss_where_both_levels_share_a_network() {
    codes_follow_their_gradient(&small_cones());
}

fn rays(data: &Dataset, view: usize) -> Vec<Ray> {
    let camera = data.view(view).camera;
    data.view(view).rays(0..camera.height).map(|ray| ray.unwrap()).collect()
}

fn shown_in(system: &dyn System, rays: &[Ray], appearance: Appearance) -> Layers {
    let layers = LayerRequest { normals: Normals::Compute, ..LayerRequest::default() };
    system.render(rays, &Query { layers, appearance, ..plain_query([1.0; 3], 0.0) })
}

fn trained(steps: u64, data: &Dataset) -> TwoLevel<NerfConfig> {
    let mut system = system(small(), Both::new());
    for step in 0..steps {
        let stats = system.step(data, step).unwrap();
        assert!(stats.nonfinite == 0 && stats.loss.is_finite(), "step {step}: {stats:?}");
    }
    system
}

fn state_of(system: &dyn System) -> TensorMap {
    system.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

#[test]
fn appearance_changes_colours_and_nothing_else() {
    let data = data(12);
    let system = trained(30, &data);
    assert_eq!(system.name(), "both");
    let rays = rays(&data, 0);
    let [first, second] = [0, 3].map(|view| shown_in(&system, &rays, Appearance::View(view)));
    assert_ne!(first.rgb, second.rgb);
    assert!(Layers { rgb: Vec::new(), ..first.clone() } == Layers { rgb: Vec::new(), ..second });
    assert!(first.opacity.iter().any(|&o| o > 0.5), "there is nothing to see");
    let code = system.appearance_code(&Appearance::View(0)).unwrap();
    assert_eq!(code.len(), DIMS[0]);
    assert!(shown_in(&system, &rays, Appearance::Code(code.into())) == first);
    // Points have the mean appearance, whose code is the mean of all.
    let mean = system.appearance_code(&Appearance::Mean).unwrap();
    let all: Vec<Vec<f32>> = (0..VIEWS).map(|v| system.appearance_code(&Appearance::View(v)).unwrap()).collect();
    for (k, mean) in mean.iter().enumerate() {
        let sum: f32 = all.iter().map(|code| code[k]).sum();
        assert!((sum / VIEWS as f32 - mean).abs() < 1e-6);
    }
}

/// What the photo model is shown of a training view.
fn seen(system: &TwoLevel<NerfConfig>, told: &Arc<Mutex<Told>>, data: &Dataset, view: usize) -> Vec<Pixel> {
    let visible = system.visibility(data, view).unwrap().unwrap();
    let pixels = told.lock().unwrap().shown.clone();
    assert_eq!(pixels.len(), visible.len());
    pixels
}

#[test]
fn transient_codes_change_the_transient_part_and_nothing_else() {
    let data = data(12);
    let mut state = state_of(&trained(30, &data));
    let (mut renders, mut pixels) = (Vec::new(), Vec::new());
    for shift in [0.0, 1.0] {
        let Some(TensorData::F32(codes)) = state.get_mut("both.transient").map(|t| &mut t.data) else { panic!() };
        codes.to_mut().iter_mut().for_each(|x| *x += shift);
        let photo_model = Both::new();
        let told = photo_model.told.clone();
        let mut system = system(small(), photo_model);
        system.load_state(&state).unwrap();
        renders.push(shown_in(&system, &rays(&data, 1), Appearance::View(1)));
        pixels.push(seen(&system, &told, &data, 1));
    }
    assert!(renders[0] == renders[1]);
    assert!(pixels[0] != pixels[1]);
    assert!(pixels[0].iter().any(|p| p.transient > 1e-3 && p.beta > 1e-4 && p.sigma_t > 1e-3), "{:?}", pixels[0]);
}

#[test]
fn without_transient_density_a_pixel_is_that_of_the_static_part() {
    let data = data(12);
    let mut state = state_of(&trained(20, &data));
    // The last five numbers are the biases of the head's outputs, density first.
    let Some(TensorData::F32(networks)) = state.get_mut("networks").map(|t| t.data.clone()) else { panic!() };
    let mut networks = networks.into_owned();
    let at = networks.len() - 5;
    networks[at] = -1e4;
    let tensor = |name: &str, data: &[f32]| (name.to_string(), f32_tensor(name, data).into_owned());
    state.extend([tensor("networks", &networks)]);
    let photo_model = Both::new();
    let told = photo_model.told.clone();
    let mut with = system(small(), photo_model);
    with.load_state(&state).unwrap();
    let with_head = seen(&with, &told, &data, 2);

    let photo_model = Both { with: [true, false], ..Both::new() };
    let told = photo_model.told.clone();
    let mut without = system(small(), photo_model);
    let statics = without.parameter_count() - VIEWS * (DIMS[0] + DIMS[1]);
    for name in ["networks", "adam.m", "adam.v"] {
        let all = take_f32(&state, name, networks.len()).unwrap();
        state.extend([tensor(name, &all[..statics])]);
    }
    without.load_state(&state).unwrap();
    let plain = seen(&without, &told, &data, 2);
    for (with, plain) in with_head.iter().zip(&plain) {
        assert_eq!(with.rgb, plain.rgb);
        assert!(with.transient < 1e-30 && with.beta < 1e-30 && with.sigma_t < 1e-30, "{with:?}");
        assert_eq!([plain.transient, plain.beta, plain.sigma_t], [0.0; 3]);
    }
    assert!(plain.iter().any(|p| p.rgb != [1.0; 3]));
}

/// Everything after `steps` on `threads` threads, from `state` if there is one, and the pixels judged last.
fn run_on(threads: usize, steps: std::ops::Range<u64>, state: Option<&TensorMap>) -> (TensorMap, Vec<Pixel>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let drawing = Drawing::Patches(Patches { shape: Shape::Window, side: 4 }, 5);
        let photo_model = Both { drawing, ..Both::new() };
        let told = photo_model.told.clone();
        let mut system = system(small(), photo_model);
        if let Some(state) = state {
            system.load_state(state).unwrap();
        }
        let data = data(12);
        for step in steps {
            let stats = system.step(&data, step).unwrap();
            assert_eq!(stats.rays, 80, "five patches at least");
        }
        let judged = told.lock().unwrap().judged.clone();
        (state_of(&system), judged)
    })
}

#[test]
fn the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let one = run_on(1, 0..6, None);
    for threads in [2, 4] {
        assert!(run_on(threads, 0..6, None) == one, "{threads} threads");
    }
    let half = run_on(2, 0..3, None).0;
    assert!(run_on(2, 3..6, Some(&half)) == one, "resumed");
}

#[test]
fn a_method_judges_the_pixels_it_then_learns_from() {
    let data = data(12);
    let photo_model = Both::new();
    let told = photo_model.told.clone();
    let mut system = system(small(), photo_model);
    for step in 0..4 {
        system.step(&data, step).unwrap();
    }
    let told = told.lock().unwrap();
    assert_eq!(told.judged.len(), 48);
    assert!(told.judged == told.pixels);
}

#[test]
fn a_survey_shows_every_view_and_starts_anew() {
    let data = data(8);
    let photo_model = Both { survey_before: Some(3), ..Both::new() };
    let told = photo_model.told.clone();
    let mut system = system(small(), photo_model);
    let mut first = Vec::new();
    for step in 0..5 {
        system.step(&data, step).unwrap();
        let state = state_of(&system);
        let TensorData::U64(counters) = &state["counters"].data else { panic!() };
        // Steps of Adam; those of the guard go on.
        assert_eq!(counters[..2], [if step < 3 { step + 1 } else { step - 2 }, step + 1]);
        if step % 3 == 0 {
            first.push(take_f32(&state, "networks", system.parameter_count() - VIEWS * 5).unwrap());
        }
    }
    assert_ne!(first[0], first[1], "the new networks are the old ones");
    assert_eq!(told.lock().unwrap().surveyed, (0..VIEWS).map(|view| (view, 64)).collect::<Vec<_>>());
}

#[test]
fn a_fit_finds_the_light_of_a_picture() {
    let data = data(16);
    let system = trained(60, &data);
    let rays = rays(&data, 0);
    let before = state_of(&system);
    let light: Arc<[f32]> = Arc::from([1.5, -1.0, 0.8]);
    let truth = shown_in(&system, &rays, Appearance::Code(light)).rgb;
    let fit = Fit {
        rays: &rays,
        rgb: &truth,
        time: 0.0,
        background: [1.0; 3],
        steps: 300,
        lr: 0.05,
        seed: 1,
        halt: &engine::halt::Halt::NEVER,
    };
    let code = system.fit_appearance(&fit).unwrap();
    let error = |appearance| {
        let got = shown_in(&system, &rays, appearance).rgb;
        let squared = got.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
        squared.sum::<f64>() / (3 * truth.len()) as f64
    };
    let (mean, fitted) = (error(Appearance::Mean), error(Appearance::Code(code.clone().into())));
    assert!(mean > 1e-7 && fitted < 2e-2 * mean, "{mean:e} in the mean light, {fitted:e} with {code:?}");
    assert!(state_of(&system) == before);
    // Nothing to fit to: the mean light.
    let nothing = Fit { rays: &[], rgb: &[], ..fit };
    assert_eq!(system.fit_appearance(&nothing), system.appearance_code(&Appearance::Mean));
}
