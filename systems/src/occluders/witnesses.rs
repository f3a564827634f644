//! Whether other photos show what a marked square is thought to hide.
//!
//! Where something stands before the scene, other photos show the place behind it, and as it is rendered. Where hardly any does, the render
//! is what is wrong: nothing has taught it yet, and if the square were left out nothing ever would.

use super::expected_error::{CELLS, cell_of};

/// A photo shows a cell by this many squares at least.
const SQUARES: u32 = 2;

/// Photos that mark the cells of the unit cube, and photos that show them as they are rendered.
pub(super) struct Witnesses {
    least: u32,
    clear: Vec<u32>,
    marked: Vec<u32>,
}

/// Squares of a photo.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    /// Where the ray of each ends, in the unit cube.
    pub(super) place: &'a [[f32; 3]],
    pub(super) marks: &'a [bool],
    /// Which show anything but the backdrop.
    pub(super) evidence: &'a [bool],
}

impl Witnesses {
    /// Of all photos. A place is known where `least` of them show it clear, and no fewer than mark it.
    pub(super) fn new<'a>(least: u32, photos: impl Iterator<Item = Seen<'a>>) -> Self {
        let cells = CELLS * CELLS * CELLS + 1;
        let mut all = Self { least, clear: vec![0; cells], marked: vec![0; cells] };
        for photo in photos {
            let mut of_photo: Vec<(u32, bool)> = (0..photo.place.len())
                .filter(|i| photo.evidence[*i])
                .map(|i| (cell_of(photo.place[i]) as u32, photo.marks[i]))
                .collect();
            of_photo.sort_unstable();
            for same in of_photo.chunk_by(|a, b| a == b).filter(|same| same.len() >= SQUARES as usize) {
                let (cell, marked) = same[0];
                let counts = if marked { &mut all.marked } else { &mut all.clear };
                counts[cell as usize] += 1;
            }
        }
        all
    }

    /// Whether other photos know a place well enough to say that a photo which marks it shows something else.
    pub(super) fn know(&self, place: [f32; 3]) -> bool {
        let cell = cell_of(place);
        self.clear[cell] >= self.least && self.clear[cell] >= self.marked[cell]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: [f32; 3] = [0.4; 3];
    const THERE: [f32; 3] = [0.9; 3];

    fn known(least: u32, photos: &[(&[[f32; 3]], &[bool])]) -> [bool; 3] {
        let evidence = [true; 8];
        let seen = photos.iter().map(|(place, marks)| Seen { place, marks, evidence: &evidence[..marks.len()] });
        let witnesses = Witnesses::new(least, seen);
        [HERE, THERE, [f32::NAN; 3]].map(|place| witnesses.know(place))
    }

    #[test]
    fn a_place_is_known_where_enough_photos_show_it_and_no_fewer_than_mark_it() {
        let clear: (&[_], &[_]) = (&[HERE, HERE, THERE, THERE], &[false; 4]);
        let marked: (&[_], &[_]) = (&[HERE, HERE, THERE, THERE], &[true, true, false, false]);
        assert_eq!(known(3, &[clear, clear, marked]), [false, true, false]);
        assert_eq!(known(2, &[clear, clear, marked]), [true, true, false]);
        assert_eq!(known(2, &[clear, clear, marked, marked, marked]), [false, true, false]);
        // What is nowhere is a place of its own, and one square is not enough.
        let sky: (&[_], &[_]) = (&[[f32::NAN; 3], [f32::NAN; 3], HERE], &[false; 3]);
        assert_eq!(known(2, &[sky, sky]), [false, false, true]);
        assert_eq!(known(0, &[]), [true; 3]);
    }

    #[test]
    fn the_backdrop_is_no_evidence() {
        let seen = Seen { place: &[HERE; 2], marks: &[false; 2], evidence: &[false, true] };
        assert!(!Witnesses::new(1, std::iter::once(seen)).know(HERE));
    }
}
