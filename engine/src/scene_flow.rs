//! Scene flow by a canonical map: where a point goes from one time to another if it stays the same point of the canonical scene.
//!
//! ```text
//! flow = y - x,   canonical(y, to) = canonical(x, from)
//! y <- y + A (canonical(x, from) - canonical(y, to)),   y = x at first,   A = (d canonical / d x)^-1 at (x, from)
//! ```
//!
//! With `A = 1` this is the plain fixed-point iteration. It diverges where the canonical scene is turned by 60 degrees or more against
//! the scene of the time, and things turn by more than that. `A` is taken at `from`, because then the thing is known to be at `x`; one
//! frame on it is nearly the same. Where the map is flat, `A = 1`.
//!
//! Steps are bounded in number and length. A step that comes no nearer is halved, and the nearest point is given: where nothing is
//! found, the point stays where it is. So it does where the map sends everything to one place.
//!
//! This room knows no system: a map is a function.

use glam::{DMat3, DVec3};

/// A canonical map: points at a time, the time, and the canonical points `[points]`, written.
pub type CanonicalMap<'a> = dyn Fn(&[[f64; 3]], f64, &mut [[f64; 3]]) + 'a;

/// Most steps of a search.
const STEPS: usize = 20;
/// A canonical point is found again within this share of the size: maps in `f32` tell no nearer ones apart.
const NEAR: f64 = 1e-6;
/// Longest step, share of the size: what is found then is the nearest such point, not one across the scene.
const LONGEST: f64 = 0.1;
/// How far beside a point derivatives are taken, share of the size: far enough for maps in `f32`.
const BESIDE: f64 = 3e-4;
/// A map is flat where it shrinks a volume to less than this share of what its largest stretch alone would make of it.
const FLAT: f64 = 1e-3;

/// A point that is looked for.
struct Search {
    /// Its canonical point.
    wanted: DVec3,
    /// Canonical ways to ways of the scene.
    a: DMat3,
    /// The nearest so far.
    y: DVec3,
    /// What its canonical point lacks of the one that is wanted.
    off: DVec3,
    /// Share of a full step that is tried next.
    share: f64,
}

impl Search {
    /// The point that is tried next.
    fn next(&self, longest: f64) -> DVec3 {
        self.y + (self.a * self.off).clamp_length_max(longest) * self.share
    }

    /// Keep a point that was tried if it is nearer.
    fn judge(&mut self, y: DVec3, canonical: DVec3) {
        let off = self.wanted - canonical;
        // What is not a number is not nearer.
        if off.length() < self.off.length() {
            (self.y, self.off, self.share) = (y, off, 1.0);
        } else {
            self.share *= 0.5;
        }
    }
}

/// Scene flow of points from a time to another, by a canonical map. A point's flow does not depend on the other points.
///
/// # Shapes and units
/// * `size`   half the diagonal of the scene, world units, above 0: steps and tolerances are shares of it
/// * `points` `[n]`, where they are at the time `from`, the scene's frame, world units
/// * `out`    `[n]`, where they are at the time `to` minus where they are at `from`, written; `None` where the map is not finite
///
/// # Panics
/// When `out` and `points` differ in length.
pub fn by_canonical(
    map: &CanonicalMap<'_>,
    size: f64,
    points: &[[f64; 3]],
    from: f64,
    to: f64,
    out: &mut [Option<[f64; 3]>],
) {
    assert_eq!(points.len(), out.len(), "points, and room for the flow of each");
    let (wanted, there) = (ask(map, points, from), ask(map, points, to));
    let inverses = inverses(map, BESIDE * size, points, from);
    let begun = points.iter().zip(wanted).zip(there).zip(inverses);
    let mut all: Vec<Search> = begun
        .map(|(((&x, wanted), there), a)| Search { wanted, a, y: x.into(), off: wanted - there, share: 1.0 })
        .collect();
    for _ in 0..STEPS {
        let is_open = |search: &&mut Search| search.off.is_finite() && search.off.length() > NEAR * size;
        let mut open: Vec<&mut Search> = all.iter_mut().filter(is_open).collect();
        if open.is_empty() {
            break;
        }
        let tried: Vec<[f64; 3]> = open.iter().map(|search| search.next(LONGEST * size).to_array()).collect();
        for ((search, &y), canonical) in open.iter_mut().zip(&tried).zip(ask(map, &tried, to)) {
            search.judge(y.into(), canonical);
        }
    }
    for ((out, search), &x) in out.iter_mut().zip(&all).zip(points) {
        *out = search.off.is_finite().then(|| (search.y - DVec3::from(x)).to_array());
    }
}

/// Canonical points.
fn ask(map: &CanonicalMap<'_>, points: &[[f64; 3]], time: f64) -> Vec<DVec3> {
    let mut there = vec![[f64::NAN; 3]; points.len()];
    map(points, time, &mut there);
    there.into_iter().map(DVec3::from).collect()
}

/// Inverses of the map's derivatives at points, by differences to both sides.
fn inverses(map: &CanonicalMap<'_>, beside: f64, points: &[[f64; 3]], time: f64) -> Vec<DMat3> {
    let ways = DVec3::AXES.map(|axis| axis * beside);
    let around = |x: DVec3| ways.map(|way| [(x + way).to_array(), (x - way).to_array()]);
    let places: Vec<[f64; 3]> = points.iter().flat_map(|&x| around(x.into())).flatten().collect();
    let there = ask(map, &places, time);
    let derivative = |[a, b, c, d, e, f]: &[DVec3; 6]| DMat3::from_cols(*a - *b, *c - *d, *e - *f) * (0.5 / beside);
    there.as_chunks::<6>().0.iter().map(|around| inverse(derivative(around))).collect()
}

/// The inverse of a derivative; 1 where it is flat or not finite.
fn inverse(j: DMat3) -> DMat3 {
    let longest = j.x_axis.length().max(j.y_axis.length()).max(j.z_axis.length());
    // What is not a number is above nothing.
    if j.determinant().abs() > FLAT * longest.powi(3) { j.inverse() } else { DMat3::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::synthetic::{Orbit, OrbitMotion, OrbitOptions, Snapshot, SnapshotHit, orbit_views};

    /// Half the diagonal of the scenes here.
    const SIZE: f64 = 1.6;

    fn flow(map: &CanonicalMap<'_>, points: &[DVec3], from: f64, to: f64) -> Vec<Option<DVec3>> {
        let points: Vec<[f64; 3]> = points.iter().map(DVec3::to_array).collect();
        let mut out = vec![Some([9.0; 3]); points.len()];
        by_canonical(map, SIZE, &points, from, to, &mut out);
        out.into_iter().map(|flow| flow.map(DVec3::from)).collect()
    }

    /// A map that does the same to each point.
    fn each(of: impl Fn(DVec3, f64) -> DVec3) -> impl Fn(&[[f64; 3]], f64, &mut [[f64; 3]]) {
        move |points, time, out| out.iter_mut().zip(points).for_each(|(out, &x)| *out = of(x.into(), time).to_array())
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
        let (mut found, mut turned) = (0, 0);
        for thing in 0..start.things() {
            let rest = start.placement(thing);
            let map = each(|x, time| rest.place(stage.at(time).placement(thing).material(x)));
            // A frame of 80 on, early and late; and back.
            for [from, to] in [[0.1, 0.1 + 1.0 / 79.0], [0.9, 0.9 + 1.0 / 79.0], [1.0, 1.0 - 1.0 / 79.0]] {
                let (now, then) = (stage.at(from), stage.at(to));
                let hits = seen(&now, thing);
                let points: Vec<DVec3> = hits.iter().map(|hit| hit.x).collect();
                for (hit, flow) in hits.iter().zip(flow(&map, &points, from, to)) {
                    let off = (flow.unwrap() - (then.place(hit) - hit.x)).length();
                    assert!(off < 1e-5, "thing {thing} at {from}: off by {off} at {}", hit.x);
                    found += 1;
                }
                // The plain iteration goes apart where `|1 - J|` is above 1.
                let way = rest.r * now.placement(thing).r.transpose() - DMat3::IDENTITY;
                turned += usize::from(way.x_axis.length() > 1.2);
            }
        }
        assert!(found > 500 && turned >= 2, "{found} points; turned {turned} times");
    }

    #[test]
    fn what_rests_and_what_is_all_in_one_place_has_no_flow() {
        let points: Vec<DVec3> = (0..20).map(|k| DVec3::new(f64::from(k).sin(), f64::from(k).cos(), 0.1)).collect();
        let rest = flow(&each(|x, _| x), &points, 0.2, 0.8);
        assert!(rest.iter().all(|flow| *flow == Some(DVec3::ZERO)), "{rest:?}");
        let one_place = flow(&each(|_, _| DVec3::ONE), &points, 0.2, 0.8);
        assert!(one_place.iter().all(|flow| *flow == Some(DVec3::ZERO)), "{one_place:?}");
        assert!(flow(&each(|x, _| x), &[], 0.2, 0.8).is_empty());
    }

    #[test]
    fn searches_that_find_nothing_are_bounded_and_what_is_no_number_has_no_flow() {
        // From 0.5 on nothing is below the ground any more.
        let folded = each(|x, time| if time < 0.5 { x } else { DVec3::new(x.x, x.y, x.z.abs() + 0.05) });
        let points = [DVec3::new(0.1, 0.2, -0.3), DVec3::new(0.1, 0.2, 0.3)];
        let found = flow(&folded, &points, 0.2, 0.8);
        let lost = found[0].unwrap();
        assert!(lost.is_finite() && lost.length() < 1.0, "{lost}");
        assert!((found[1].unwrap() - DVec3::new(0.0, 0.0, -0.05)).length() < 1e-5, "{found:?}");
        // A hole in the map is that of one point, not of the one beside it.
        let hole = each(|x, _| if x.z < 0.0 { DVec3::NAN } else { x + DVec3::X });
        assert_eq!(flow(&hole, &points, 0.2, 0.8), [None, Some(DVec3::ZERO)]);
    }
}
