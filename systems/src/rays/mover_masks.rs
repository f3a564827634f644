//! What motion masks say moves: pixels of photos, and their tiles.
//!
//! Other programs make them, one for each photo. Where a photo has none it is not known what moves in it, and what moves in the scene has
//! to be found otherwise.

use super::residuals::PhotoTile;
use engine::data::{Dataset, View};
use rayon::prelude::*;
use scene_io::{BitMask, SceneError};

/// Share of a tile's pixels that move where it does.
const OF_TILE: f32 = 0.1;

/// Motion masks of photos at the size of the training; set where something moves.
#[derive(Clone, Debug)]
pub(super) struct MoverMasks {
    /// `[views]`; `None` where a photo has none.
    masks: Vec<Option<BitMask>>,
}

impl MoverMasks {
    /// These masks, one for each view or none.
    pub(super) fn new(masks: Vec<Option<BitMask>>) -> Self {
        Self { masks }
    }

    /// Those of the training views.
    ///
    /// # Errors
    /// [`SceneError`] naming the file of a mask that cannot be read, or is of another shape than its photo.
    pub(super) fn of(data: &Dataset) -> Result<Self, SceneError> {
        let masks = data.views().par_iter().map(Self::of_view).collect::<Result<Vec<_>, _>>()?;
        Ok(Self::new(masks))
    }

    /// That of a view.
    ///
    /// # Errors
    /// As [`MoverMasks::of`].
    pub(super) fn of_view(view: &View) -> Result<Option<BitMask>, SceneError> {
        let (width, height) = (view.camera.width, view.camera.height);
        Ok(view.source.read_motion_mask()?.map(|mask| mask.resized(width, height)))
    }

    /// Whether any photo has one.
    pub(super) fn has_any(&self) -> bool {
        self.masks.iter().any(Option::is_some)
    }

    /// Whether all photos have one, so that they say what moves.
    pub(super) fn has_all(&self) -> bool {
        !self.masks.is_empty() && self.masks.iter().all(Option::is_some)
    }

    /// Whether a pixel moves; `None` where no mask says so.
    pub(super) fn moves(&self, view: u32, [x, y]: [u16; 2]) -> Option<bool> {
        let mask = self.masks[view as usize].as_ref()?;
        let (x, y) = (u32::from(x), u32::from(y));
        (x < mask.width() && y < mask.height()).then(|| mask.get(x, y))
    }

    /// The tiles of a photo, `side` pixels each way, as its mask has them; none without a mask.
    pub(super) fn tiles(&self, view: usize, side: u32) -> Vec<PhotoTile> {
        let Some(mask) = &self.masks[view] else { return Vec::new() };
        let (width, height, side) = (mask.width(), mask.height(), side.max(1));
        let corners =
            (0..height).step_by(side as usize).flat_map(|y| (0..width).step_by(side as usize).map(move |x| [x, y]));
        corners
            .map(|[x, y]| {
                let [last_x, last_y] = [(x + side).min(width), (y + side).min(height)];
                let inside = (y..last_y).flat_map(|y| (x..last_x).map(move |x| (x, y)));
                let moving = inside.filter(|&(x, y)| mask.get(x, y)).count();
                let pixels = (last_x - x) * (last_y - y);
                PhotoTile { middle: [x + side / 2, y + side / 2], moves: moving as f32 > OF_TILE * pixels as f32 }
            })
            .collect()
    }

    /// What they say, a line of the plan.
    pub(super) fn line(&self) -> String {
        let n = self.masks.len();
        let count = |is: fn(&BitMask) -> bool| self.masks.iter().flatten().filter(|mask| is(mask)).count();
        let [some, white, black] = [count(|_| true), count(is_white), count(|mask| mask.count() == 0)];
        match some {
            0 => "movers: no motion masks (`motion_masks/`), so they are found by what a still field leaves of the photos".into(),
            some if some < n => format!(
                "movers: {some} of {n} photos have a motion mask, so they are found by what a still field leaves of the photos"
            ),
            _ if white == n => "movers: everything, as the motion masks of all photos say, so the still part learns from nothing".into(),
            _ if black == n => "movers: none, as the motion masks of all photos say".into(),
            _ => "movers: as the motion masks of all photos say".into(),
        }
    }
}

/// Whether all pixels move.
fn is_white(mask: &BitMask) -> bool {
    mask.count() == u64::from(mask.width()) * u64::from(mask.height())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One photo whose left half moves, and one that has no mask.
    fn half() -> MoverMasks {
        MoverMasks::new(vec![Some(BitMask::from_fn(8, 8, |x, _| x < 4)), None])
    }

    #[test]
    fn tiles_move_where_enough_of_their_pixels_do() {
        let tiles = half().tiles(0, 4);
        assert_eq!(tiles.iter().map(|tile| tile.moves).collect::<Vec<_>>(), [true, false, true, false]);
        assert_eq!(tiles[3].middle, [6, 6]);
        assert!(half().tiles(1, 4).is_empty());
        // Those of the last column have one pixel in a row: two of four are more than a tenth, one of sixteen is not.
        let masks = MoverMasks::new(vec![Some(BitMask::from_fn(5, 4, |x, y| [x, y] == [1, 1] || (x == 4 && y < 2)))]);
        assert_eq!(masks.tiles(0, 4).iter().map(|tile| tile.moves).collect::<Vec<_>>(), [false, true]);
    }

    #[test]
    fn pixels_without_a_mask_are_not_known() {
        let masks = half();
        assert_eq!([[3, 7], [4, 7]].map(|place| masks.moves(0, place)), [Some(true), Some(false)]);
        assert_eq!([masks.moves(0, [8, 0]), masks.moves(0, [0, 8]), masks.moves(1, [0, 0])], [None; 3]);
    }

    #[test]
    fn all_photos_must_have_one_and_plans_say_how_many_do() {
        let of = |masks: [Option<BitMask>; 2]| MoverMasks::new(masks.to_vec());
        let [black, white] = [false, true].map(|moves| BitMask::from_fn(3, 3, |_, _| moves));
        let cases = [
            ([None, None], [false, false], "movers: no motion masks"),
            ([None, Some(white.clone())], [true, false], "movers: 1 of 2 photos have a motion mask, so they are found"),
            ([Some(black.clone()), Some(white.clone())], [true, true], "movers: as the motion masks of all photos say"),
            ([Some(black.clone()), Some(black)], [true, true], "movers: none, as the motion masks"),
            ([Some(white.clone()), Some(white)], [true, true], "movers: everything, as the motion masks"),
        ];
        for (masks, known, said) in cases {
            let masks = of(masks);
            assert_eq!([masks.has_any(), masks.has_all()], known, "{said}");
            assert!(masks.line().starts_with(said), "{} instead of {said}", masks.line());
        }
        assert!(!MoverMasks::new(Vec::new()).has_all(), "no photos say nothing");
    }
}
