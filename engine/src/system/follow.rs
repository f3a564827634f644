//! Where points go, by where they are canonical.
//!
//! What is at `x` at a time is, at another time, where what has the same canonical place is. From `y = x`:
//!
//! ```text
//! r = canonical(x, from) - canonical(y, to),   y <- y + r               until r is next to nothing
//! ```
//!
//! That ends where a deformation turns things by less than 60 degrees and stretches them by less than a factor of two. Points for which
//! it does not end begin again by Newton's method, `y <- y + J^-1 r` with `J` the derivative of `canonical(., to)` at `y`: differences
//! to three places beside it, however things are turned. Of points that are not found then nothing is known: a deformation may send two
//! places to one, or none to some.

use glam::{DMat3, DVec3};

/// What a system says of where points go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlowSource {
    /// Nothing: all points stay where they are.
    Nothing,
    /// A deformation into the canonical scene.
    Canonical,
    /// Scene flow that was learned as such.
    Learned,
}

/// Writes canonical points of points at a time.
pub type CanonicalPoints<'a> = dyn Fn(&[[f64; 3]], f64, &mut [[f64; 3]]) + 'a;

/// Distance of canonical places that counts as none, longest sides of the scene's box: a hundredth of a pixel where the box fills a
/// picture of a thousand.
const TOLERANCE: f64 = 1e-5;
/// Rounds until a point begins again. Where each leaves half of the distance, as many leave less than the tolerance of a side.
const ROUNDS: usize = 24;
/// Rounds of Newton's method until a point counts as lost.
const NEWTON_ROUNDS: usize = 8;
/// Step of differences, longest sides of the box: canonical places are known to `f32`.
const STEP: f64 = 1e-3;
/// Determinant of a derivative below which space is taken for folded there.
const FOLDED: f64 = 1e-3;

/// Displacements of points of the scene's frame from the time `times[0]` to the time `times[1]`, world units, written over `out`;
/// `None` where the search does not end. However many points there are, `canonical` is called 44 times at most.
///
/// # Shapes and units
/// * `canonical` as [`System::canonical`](super::System::canonical) of a system
/// * `bounds` box of the scene's frame, `[min, max]`: what lengths are compared with
/// * `points`, `out` `[n]`, world units
///
/// # Numerics
/// Points outside of the box are found to a distance that grows with the square of theirs, as the digits of contracted space do.
///
/// # Panics
/// If `points` and `out` differ in length.
pub fn follow_canonical(
    canonical: &CanonicalPoints<'_>,
    bounds: [[f64; 3]; 2],
    points: &[[f64; 3]],
    times: [f64; 2],
    out: &mut [Option<[f64; 3]>],
) {
    assert_eq!(points.len(), out.len(), "a point has one displacement");
    let [from, to] = times;
    let [min, max] = bounds.map(DVec3::from);
    let (middle, side) = (0.5 * (min + max), (max - min).max_element());
    let mut sought = points.to_vec();
    canonical(points, from, &mut sought);
    let way = |(i, (x, sought)): (usize, (&[f64; 3], [f64; 3]))| {
        let x = DVec3::from(*x);
        let far = (2.0 * (x - middle).abs().max_element() / side).max(1.0);
        Way { i, x, y: x, sought: DVec3::from(sought), off: DVec3::NAN, far }
    };
    let ways: Vec<Way> = points.iter().zip(sought).enumerate().map(way).collect();
    out.fill(None);
    let search = Search { canonical, to, side };
    let mut lost = search.run(ways, ROUNDS, |ways| ways.iter().map(|way| way.off).collect(), out);
    lost.iter_mut().for_each(|way| way.y = way.x);
    search.run(lost, NEWTON_ROUNDS, |ways| search.newton(ways), out);
}

/// A point on its way to where it is at the other time.
#[derive(Clone, Copy)]
struct Way {
    i: usize,
    x: DVec3,
    y: DVec3,
    /// Its canonical place, and how far that is from the one of `y`.
    sought: DVec3,
    off: DVec3,
    /// Distance from the middle of the box, half sides; 1 in the box.
    far: f64,
}

struct Search<'a> {
    canonical: &'a CanonicalPoints<'a>,
    to: f64,
    /// Longest side of the box.
    side: f64,
}

impl Search<'_> {
    fn canonical_of(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut there = points.to_vec();
        (self.canonical)(points, self.to, &mut there);
        there
    }

    /// Displacements of points that are found are written; the others are returned.
    fn run(
        &self,
        mut ways: Vec<Way>,
        rounds: usize,
        steps: impl Fn(&[Way]) -> Vec<DVec3>,
        out: &mut [Option<[f64; 3]>],
    ) -> Vec<Way> {
        let mut lost = Vec::new();
        for _ in 0..=rounds {
            if ways.is_empty() {
                break;
            }
            let at: Vec<[f64; 3]> = ways.iter().map(|way| way.y.to_array()).collect();
            for (way, there) in ways.iter_mut().zip(self.canonical_of(&at)) {
                way.off = way.sought - DVec3::from(there);
            }
            ways.retain(|way| {
                let found = way.off.length() <= TOLERANCE * self.side * way.far * way.far;
                if found {
                    out[way.i] = Some((way.y - way.x).to_array());
                }
                !found
            });
            let steps = steps(&ways);
            let mut going = Vec::with_capacity(ways.len());
            for (way, step) in ways.into_iter().zip(steps) {
                let y = way.y + step;
                if y.is_finite() {
                    going.push(Way { y, ..way });
                } else {
                    lost.push(way);
                }
            }
            ways = going;
        }
        lost.extend(ways);
        lost
    }

    /// Steps by Newton's method; no numbers where space is folded.
    fn newton(&self, ways: &[Way]) -> Vec<DVec3> {
        let step = |way: &Way| STEP * self.side * way.far;
        let beside = |way: &Way| DVec3::AXES.map(|axis| (way.y + step(way) * axis).to_array());
        let at: Vec<[f64; 3]> = ways.iter().flat_map(beside).collect();
        let there = self.canonical_of(&at);
        let steps = ways.iter().zip(there.chunks_exact(3)).map(|(way, there)| {
            let here = way.sought - way.off;
            let column = |a: usize| (DVec3::from(there[a]) - here) / step(way);
            let derivative = DMat3::from_cols(column(0), column(1), column(2));
            // False for NaN as well.
            let is_open = derivative.determinant().abs() > FOLDED;
            if is_open { derivative.inverse() * way.off } else { DVec3::NAN }
        });
        steps.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::synthetic::{Orbit, OrbitMotion, OrbitOptions, Snapshot, SnapshotHit, orbit_views};

    const BOX: [[f64; 3]; 2] = [[-1.0, -1.0, -0.5], [1.0, 1.0, 0.5]];

    fn points() -> Vec<[f64; 3]> {
        (0..40).map(|i| [0, 1, 2].map(|a| 0.8 * f64::from(3 * i + 7 * a + 1).sin())).collect()
    }

    /// Where a thing is at a time that turns about z by `turns` radians, swells by a tenth and drifts: from its canonical place.
    fn placed(p: DVec3, time: f64, turns: f64) -> DVec3 {
        let turned = DMat3::from_rotation_z(turns * time) * p;
        (1.0 + 0.1 * time) * turned + time * DVec3::new(0.1, -0.2, 0.05)
    }

    /// The inverse of that.
    fn rest(p: DVec3, time: f64, turns: f64) -> DVec3 {
        let back = (p - time * DVec3::new(0.1, -0.2, 0.05)) / (1.0 + 0.1 * time);
        DMat3::from_rotation_z(-turns * time) * back
    }

    fn found(canonical: impl Fn(DVec3, f64) -> DVec3, points: &[[f64; 3]], times: [f64; 2]) -> Vec<Option<[f64; 3]>> {
        let of_all = |points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]| {
            for (p, out) in points.iter().zip(out) {
                *out = canonical(DVec3::from(*p), time).to_array();
            }
        };
        let mut out = vec![Some([7.0; 3]); points.len()];
        follow_canonical(&of_all, BOX, points, times, &mut out);
        out
    }

    #[test]
    fn points_are_found_where_a_known_motion_takes_them() {
        let points = points();
        // Half a radian is less than 60 degrees; three are more, and eight are more than one round.
        for turns in [0.5, 3.0, 8.0] {
            for times in [[0.0, 0.1], [0.5, 0.6], [1.0, 0.9], [0.3, 0.3]] {
                let found = found(|p, time| rest(p, time, turns), &points, times);
                for (x, found) in points.iter().zip(found) {
                    let x = DVec3::from(*x);
                    let want = placed(rest(x, times[0], turns), times[1], turns) - x;
                    let off = (DVec3::from(found.unwrap()) - want).length();
                    assert!(off < 1e-4, "{turns} radians, {times:?}: {off} at {x}");
                }
            }
        }
    }

    #[test]
    fn a_bent_warp_is_undone_to_the_tolerance() {
        let bend = |p: DVec3| DVec3::new((3.0 * p.y).sin(), (2.0 * p.z).cos(), (4.0 * p.x).sin());
        let bent = |p: DVec3, time: f64| p + 0.15 * time * bend(p);
        let points = points();
        let times = [0.2, 0.9];
        for (x, found) in points.iter().zip(found(bent, &points, times)) {
            let x = DVec3::from(*x);
            let off = bent(x + DVec3::from(found.unwrap()), times[1]) - bent(x, times[0]);
            assert!(off.length() <= 2.0 * TOLERANCE, "{off} at {x}");
        }
    }

    #[test]
    fn what_stays_has_a_displacement_of_nothing() {
        let points = points();
        let still = found(|p, _| p, &points, [0.0, 1.0]);
        assert!(still.iter().all(|found| *found == Some([0.0; 3])));
        follow_canonical(&|_: &[[f64; 3]], _: f64, _: &mut [[f64; 3]]| (), BOX, &[], [0.0, 1.0], &mut []);
    }

    #[test]
    fn points_that_no_place_leads_to_are_not_found_and_calls_are_bounded() {
        // At the later time all of space lies in one plane.
        let flat = |p: DVec3, time: f64| if time > 0.5 { DVec3::new(p.x, p.y, 0.0) } else { p };
        let points = points();
        let found = found(flat, &points, [0.0, 1.0]);
        for (x, found) in points.iter().zip(&found) {
            assert_eq!(found.is_some(), x[2].abs() <= 2.0 * TOLERANCE, "{x:?}: {found:?}");
        }
        let calls = std::cell::Cell::new(0);
        let nowhere = |points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]| {
            calls.set(calls.get() + 1);
            out.copy_from_slice(points);
            if time > 0.5 {
                out.fill([5.0; 3]);
            }
        };
        let mut out = [None; 3];
        follow_canonical(&nowhere, BOX, &[[0.1; 3], [f64::NAN; 3], [0.2; 3]], [0.0, 1.0], &mut out);
        assert_eq!(out, [None; 3]);
        // Where they are, all rounds, and one of Newton's, which finds space folded.
        assert_eq!(calls.get(), 1 + (ROUNDS + 1) + 2);
    }

    /// What cameras all round see of a thing at a time.
    fn seen(snapshot: &Snapshot, thing: usize) -> Vec<SnapshotHit> {
        let views = orbit_views(&OrbitOptions { width: 24, height: 24, train: 4, test: 0, ..OrbitOptions::default() });
        let pixels = || (0..24).flat_map(|y| (0..24).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
        let hits = views.iter().flat_map(|view| pixels().map(move |pixel| (view.camera, pixel)));
        let hits = hits.filter_map(|(camera, pixel)| snapshot.hit(&camera, pixel.into()));
        hits.filter(|hit| hit.thing == thing).collect()
    }

    #[test]
    fn exact_maps_of_things_that_travel_turn_stretch_and_bend_give_their_exact_flow() {
        let stage = Orbit::new(0, OrbitMotion::Some);
        let start = stage.at(0.0);
        let (mut count, mut turned) = (0, 0);
        for thing in 0..start.things() {
            let rest = start.placement(thing);
            let canonical = |x, time| rest.place(stage.at(time).placement(thing).material(x));
            // A frame of 80 on, early and late; and back.
            for [from, to] in [[0.1, 0.1 + 1.0 / 79.0], [0.9, 0.9 + 1.0 / 79.0], [1.0, 1.0 - 1.0 / 79.0]] {
                let (now, then) = (stage.at(from), stage.at(to));
                let hits = seen(&now, thing);
                let points: Vec<[f64; 3]> = hits.iter().map(|hit| hit.x.to_array()).collect();
                for (hit, flow) in hits.iter().zip(found(canonical, &points, [from, to])) {
                    let off = (DVec3::from(flow.unwrap()) - (then.place(hit) - hit.x)).length();
                    assert!(off < 1e-4, "thing {thing} at {from}: off by {off} at {}", hit.x);
                    count += 1;
                }
                // The plain iteration goes apart where `|1 - J|` is above 1.
                let way = rest.r * now.placement(thing).r.transpose() - DMat3::IDENTITY;
                turned += usize::from(way.x_axis.length() > 1.2);
            }
        }
        assert!(count > 500 && turned >= 2, "{count} points; turned {turned} times");
    }
}
