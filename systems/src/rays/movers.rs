//! What moves, found by itself: a field at rest is trained first; where its photos differ from it to one side, or where motion masks of
//! all photos say so, something moves.
//!
//! Tiles of photos that move ([`Residuals`], [`MoverMasks`]) tell of space: a block moves where enough of the views that see it see it in
//! such a tile. From then on a part of the field is for these blocks. Where no masks say it, it is looked for [`LOOKS`] times, and blocks
//! are only added.
//!
//! Pixels that a mask says move are left out only until then: of the field at rest they would make fog. Afterwards all pixels count, as
//! the share that each part has of a pixel is learnt from them.

use super::config::RayConfig;
use super::driver::RaySystem;
use super::mover_masks::MoverMasks;
use super::moving_config::MovingConfig;
use super::photo_tiles::side_of_tile;
use super::residuals::{Compared, PhotoTile, Residuals, ToldBy};
use super::scene_flow::{Film, FlowContext};
use super::work::Work;
use crate::fields::{MovingCells, MovingPart, NETWORK_ADAM};
use crate::schedule::Done;
use crate::warps::Deform;
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use optim::Decay;
use std::fmt;

/// Stream of random numbers of the initial parameters.
const INIT: u64 = 0x6d6f_7665;
/// How often it is looked for, after as many times the share that is set: what was not sharp yet errs everywhere, and what is found then
/// may be more.
const LOOKS: u32 = 3;
/// How often after the last look cells are given back of which nothing came, as long after each other. (At each look they are, too.)
const REVIEWS: u64 = 2;

/// What is waited with until it is known what moves.
pub(super) struct Movers {
    config: MovingConfig,
    deform: Option<Deform>,
    /// `None` once it was asked what moves.
    pub(super) residuals: Option<Residuals>,
    /// What was found, and whether that was told.
    pub(super) found: Option<Found>,
    told: bool,
    /// What other programs found out about the photos; `None` where that says nothing.
    known: Option<Known>,
}

/// What other programs found out about photos.
enum Known {
    /// The frames and all their priors, where there is scene flow.
    Film(Film),
    /// What moves, as the masks of all photos say, where there is none.
    Masks(MoverMasks),
}

impl Known {
    fn film(&self) -> Option<&Film> {
        match self {
            Self::Film(film) => Some(film),
            Self::Masks(_) => None,
        }
    }

    fn masks(&self) -> &MoverMasks {
        match self {
            Self::Film(film) => film.masks(),
            Self::Masks(masks) => masks,
        }
    }
}

/// What was found to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    /// Share of the tiles of all photos.
    pub(super) tiles: f64,
    /// Share of the cells of the unit cube.
    pub(super) cells: f64,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [tiles, cells] = [self.tiles, self.cells].map(|share| 100.0 * share);
        if self.cells > 0.0 {
            write!(
                f,
                "something moves in {tiles:.1} % of the photos, and in {cells:.2} % of space: a part of the field is for that"
            )
        } else {
            write!(
                f,
                "nothing moves ({tiles:.2} % of the photos do not fit a scene at rest): the moving part is left out"
            )
        }
    }
}

impl Movers {
    pub(super) fn new(config: MovingConfig, deform: Option<Deform>) -> Self {
        Self { config, deform, residuals: None, found: None, told: false, known: None }
    }

    /// What was found, told once.
    pub(super) fn news(&mut self) -> Option<String> {
        let found = self.found.filter(|_| !self.told)?;
        self.told = true;
        Some(found.to_string())
    }

    /// What motion masks say; `None` where they are not heeded.
    fn masks(&self) -> Option<&MoverMasks> {
        self.known.as_ref().map(Known::masks)
    }

    /// Pixels that a mask says move are not for the still part: they do not count. (With scene flow that holds also where other photos
    /// have no mask.)
    pub(super) fn leave_out(&self, batch: &mut Batch) {
        let Some(masks) = self.masks() else { return };
        for (weight, (view, place)) in batch.weight.iter_mut().zip(batch.view.iter().zip(&batch.pixel)) {
            if masks.moves(*view, *place) == Some(true) {
                *weight = 0.0;
            }
        }
    }

    /// The tiles of all photos: as motion masks have them where all photos have one, else as the residuals do.
    fn tiles(&self, residuals: &Residuals, data: &Dataset) -> Vec<Vec<PhotoTile>> {
        match self.masks().filter(|masks| masks.has_all()) {
            Some(masks) => {
                let side = |view: usize| side_of_tile(&data.view(view).camera);
                (0..data.len()).map(|view| masks.tiles(view, side(view))).collect()
            }
            None => residuals.tiles(),
        }
    }

    /// What says what moves: motion masks where all photos have one.
    fn told_by(&self) -> ToldBy {
        if self.masks().is_some_and(MoverMasks::has_all) { ToldBy::Masks } else { ToldBy::Residuals }
    }

    /// Whether it is time to look for what moves, after so many looks.
    fn is_due(&self, share: f64) -> bool {
        self.residuals.as_ref().is_some_and(|residuals| share >= self.config.from() * f64::from(residuals.looks() + 1))
    }

    /// A moving part before its first step, with the deformation that waits for it.
    fn part(&mut self, config: &RayConfig, seed: u64, cells: MovingCells) -> Result<MovingPart, SystemError> {
        let rng = Rng::new(seed, INIT);
        let features = self.config.features.features(rng.substream(0))?;
        let deform = self.deform.take();
        let seen = deform.as_ref().map_or(0, Deform::seen_rows);
        let more = self.config.flow.as_ref().map_or(0, |flow| flow.head().rows());
        let network = config.networks.moving_mlp(features.rows() + seen, more)?;
        let adam = NETWORK_ADAM.with_decay(Decay::L2(f64::from(config.rates.weight_decay)));
        Ok(MovingPart::new(features, deform, network, more, cells, adam, rng.substream(1)))
    }
}

impl RaySystem {
    /// Look out for what moves in these photos, where a part of the field waits for it.
    pub(crate) fn watch(&mut self, data: &Dataset) {
        if let Some(movers) = &mut self.movers {
            movers.residuals = Some(Residuals::new(data));
        }
    }

    /// Know what other programs found out about these photos: with scene flow all of it, without what moves alone, and that only where
    /// all photos have a mask. What is known, a line each.
    ///
    /// # Errors
    /// [`SystemError::Scene`] naming the file of a prior that cannot be read, or is of another shape than its photo.
    pub(crate) fn follow_film(&mut self, data: &Dataset) -> Result<Vec<String>, SystemError> {
        let Some(movers) = &mut self.movers else { return Ok(Vec::new()) };
        if movers.config.flow.is_some() {
            let film = Film::of(data)?;
            let lines = film.lines();
            movers.known = Some(Known::Film(film));
            return Ok(lines);
        }
        let masks = MoverMasks::of(data)?;
        let lines = masks.has_any().then(|| masks.line()).into_iter().collect();
        movers.known = masks.has_all().then_some(Known::Masks(masks));
        Ok(lines)
    }

    /// Know these frames.
    #[cfg(test)]
    pub(super) fn set_film(&mut self, film: Film) {
        self.movers.as_mut().unwrap().known = Some(Known::Film(film));
    }

    /// What chunks know of scene flow in a step; `None` where nothing moves (yet), or nothing is learnt.
    pub(super) fn flow_context(&self, step: u64) -> Option<FlowContext<'_>> {
        self.field.moving.as_ref()?;
        let movers = self.movers.as_ref()?;
        let (film, config) = (movers.known.as_ref()?.film()?, movers.config.flow.as_ref()?);
        let (share, from) = (self.course.done(step).share, movers.config.from());
        Some(FlowContext { film, config, step, share, from })
    }

    /// Whether the still part is alone because it is not known yet what moves.
    pub(super) fn is_looking(&self) -> bool {
        self.field.moving.is_none() && self.movers.as_ref().is_some_and(|movers| movers.residuals.is_some())
    }

    /// Whether the still part is held as it is: something moves, and that is asked for.
    pub(super) fn still_is_held(&self) -> bool {
        let flow = self.config.moving.as_ref().and_then(|moving| moving.flow.as_ref());
        self.field.moving.is_some() && flow.is_some_and(|flow| flow.settings.still_freezes)
    }

    /// Learn from the batch of a step what moves.
    pub(super) fn look_for_movers(&mut self, step: u64) {
        let Some(mut movers) = self.movers.take() else { return };
        let by_masks = movers.told_by() == ToldBy::Masks;
        if let Some(residuals) = movers.residuals.as_mut().filter(|_| !by_masks) {
            self.gather_seen();
            let Work { inputs, seen, .. } = &self.work;
            let compared =
                seen.iter().zip(&inputs.truth).map(|(pixel, truth)| Compared { shown: pixel.rgb, truth: *truth });
            residuals.learn(step, &inputs.batch, compared);
        }
        self.movers = Some(movers);
    }

    /// When it is time, see what moves, and have a part of the field for that.
    ///
    /// # Errors
    /// [`SystemError::Config`] for features that cannot be.
    pub(super) fn begin_movers(&mut self, data: &Dataset, step: u64) -> Result<(), SystemError> {
        let done = self.course.done(step);
        self.give_back_idle(done.share);
        let Some(movers) = self.movers.as_ref().filter(|movers| movers.is_due(done.share)) else { return Ok(()) };
        let Some(residuals) = &movers.residuals else { return Ok(()) };
        let by = movers.told_by();
        let last = by == ToldBy::Masks || residuals.looks() + 1 >= LOOKS;
        let (cells, tiles) = self.moving_places(data, &movers.tiles(residuals, data), by);
        let Some(movers) = &mut self.movers else { return Ok(()) };
        movers.residuals = movers.residuals.take().filter(|_| !last).map(Residuals::looked);
        if cells.count() > 0 {
            let part = match self.field.moving.take() {
                Some(mut part) => {
                    part.cells.unite(&cells);
                    part
                }
                None => {
                    let mut part = movers.part(&self.config, self.seed, cells)?;
                    part.features.refine(done);
                    part.deform.iter_mut().for_each(|deform| deform.begin(done.share));
                    part.begin_as(&*self.field.features, &self.field.density, &self.field.density_params);
                    part
                }
            };
            if let Some(occupancy) = self.sampler.occupancy_mut() {
                occupancy.reopen(&part.cells, &self.space);
            }
            self.field.moving = Some(part);
        }
        let moving = self.field.moving.as_ref().map_or(0, |part| part.cells.count());
        let tiles = movers.found.map_or(tiles, |before| tiles.max(before.tiles));
        movers.found = Some(Found { tiles, cells: moving as f64 / MovingCells::ALL as f64 });
        // That nothing moves is not told before the last look.
        movers.told = moving == 0 && !last;
        Ok(())
    }

    /// When it is time, give back cells of the moving part of which nothing came; all of it, where that is all of them in the end. Masks
    /// are taken at their word.
    pub(super) fn give_back_idle(&mut self, share: f64) {
        let (Some(movers), Some(part)) = (&self.movers, &self.field.moving) else { return };
        let is_last_look_over = movers.residuals.is_none();
        let due = match is_last_look_over {
            true => {
                part.reviews < REVIEWS && share >= movers.config.from() * (u64::from(LOOKS) + 1 + part.reviews) as f64
            }
            false => movers.is_due(share),
        };
        if !due || movers.told_by() == ToldBy::Masks {
            return;
        }
        let cells = self.cells_of_use();
        let (Some(movers), Some(part)) = (&mut self.movers, &mut self.field.moving) else { return };
        part.reviews += u64::from(is_last_look_over);
        let last = part.reviews == REVIEWS;
        if let Some(found) = &mut movers.found {
            found.cells = cells.count() as f64 / MovingCells::ALL as f64;
            movers.told &= !last;
        }
        if last && cells.count() == 0 {
            self.field.moving = None;
        } else {
            part.cells = cells;
        }
    }

    /// A part for what moves, which moves everywhere and is of random numbers.
    #[cfg(test)]
    pub(super) fn move_everywhere(&mut self) {
        let movers = self.movers.as_mut().unwrap();
        let mut part = movers.part(&self.config, self.seed, MovingCells::everywhere()).unwrap();
        part.begin_as(&*self.field.features, &self.field.density, &self.field.density_params);
        let uniform = |stream: u64, i: usize| Rng::new(self.seed, stream).uniform_at(i as u64);
        part.features.parameters_mut().iter_mut().enumerate().for_each(|(i, x)| *x = 4.0 * (uniform(7, i) - 0.5));
        part.params.iter_mut().enumerate().for_each(|(i, x)| *x = 3.0 * (uniform(8, i) - 0.5));
        part.pack();
        self.field.moving = Some(part);
    }

    /// What a checkpoint holds of what is looked for.
    pub(super) fn movers_state(&self) -> Vec<Tensor<'_>> {
        let residuals = self.movers.iter().filter_map(|movers| movers.residuals.as_ref());
        residuals.flat_map(Residuals::state).chain(self.field.moving.iter().flat_map(MovingPart::state)).collect()
    }

    /// Put back what [`RaySystem::movers_state`] gave when so much of the run was done.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(super) fn load_movers(&mut self, state: &TensorMap, done: Done) -> Result<(), SystemError> {
        let Some(movers) = &mut self.movers else { return Ok(()) };
        let waits = done.share < movers.config.from() || Residuals::is_in(state);
        movers.residuals = match movers.residuals.take().filter(|_| waits) {
            Some(residuals) => Some(residuals.restored(state)?),
            None => None,
        };
        if let Some(cells) = MovingPart::cells_of(state)? {
            let mut part = match self.field.moving.take() {
                Some(mut part) => {
                    part.cells = cells;
                    part
                }
                None => movers.part(&self.config, self.seed, cells)?,
            };
            part.load_state(state, done)?;
            self.field.moving = Some(part);
        }
        Ok(())
    }
}
