//! The nearest neighbours of points: exact, by a balanced k-d tree.
//!
//! Every node is the median of its range along the widest axis, so the tree is as deep with many points at one place as
//! without (where buckets of a fixed size are split by value, they overflow).

use rayon::prelude::*;

/// Neighbours that are found: those that tell how large a Gaussian starts.
pub const NEIGHBOURS: usize = 3;
/// Points of a range that is searched one by one.
const LEAF: usize = 8;
/// Ranges above this are built by two threads.
const LARGE: usize = 1 << 12;

#[derive(Clone, Copy)]
struct Node {
    x: [f64; 3],
    id: u32,
    /// Along which its range is split.
    axis: u8,
}

/// A point that is near another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Squared distance.
    pub squared: f64,
    /// Its number.
    pub index: u32,
}

const NOBODY: Neighbour = Neighbour { squared: f64::INFINITY, index: u32::MAX };

/// Points, to be asked for those that are nearest to a place.
#[derive(Clone)]
pub struct Neighbours {
    nodes: Vec<Node>,
}

impl Neighbours {
    /// Of some points, no more than `u32` can count. A place with a coordinate that is not finite has no neighbours.
    #[must_use]
    pub fn new(points: &[[f64; 3]]) -> Self {
        let node = |(i, &x): (usize, &[f64; 3])| Node { x, id: i as u32, axis: 0 };
        let mut nodes: Vec<Node> = points.iter().enumerate().map(node).collect();
        build(&mut nodes);
        Self { nodes }
    }

    /// The nearest points to `x`, the nearest first; as many as there are, at most [`NEIGHBOURS`].
    pub fn nearest(&self, x: &[f64; 3]) -> impl Iterator<Item = Neighbour> + use<> {
        let mut best = [NOBODY; NEIGHBOURS];
        search(&self.nodes, x, u32::MAX, &mut best);
        best.into_iter().filter(|neighbour| neighbour.index != u32::MAX)
    }
}

/// Mean **squared** distance of each point to the three nearest others, or to all others where there are fewer; 0 for a point
/// alone. The same bits with any number of threads.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, released code.
pub fn mean_squared_distances(points: &[[f64; 3]]) -> Vec<f64> {
    let others = NEIGHBOURS.min(points.len().saturating_sub(1));
    let Neighbours { nodes } = Neighbours::new(points);
    let of = |(i, x): (usize, &[f64; 3])| {
        let mut best = [NOBODY; NEIGHBOURS];
        search(&nodes, x, i as u32, &mut best);
        best[..others].iter().map(|neighbour| neighbour.squared).sum::<f64>() / others.max(1) as f64
    };
    points.par_iter().enumerate().map(of).collect()
}

/// Order a range: what is not larger, the median, what is not smaller, along its widest axis.
fn build(nodes: &mut [Node]) {
    if nodes.len() <= LEAF {
        return;
    }
    let extent = |axis: usize| {
        let [min, max] = nodes
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], n| [min.min(n.x[axis]), max.max(n.x[axis])]);
        max - min
    };
    let sizes = [0, 1, 2].map(extent);
    let axis = (1..3).fold(0, |widest, axis| if sizes[axis] > sizes[widest] { axis } else { widest });
    let middle = nodes.len() / 2;
    nodes.select_nth_unstable_by(middle, |a, b| a.x[axis].total_cmp(&b.x[axis]));
    nodes[middle].axis = axis as u8;
    let (low, rest) = nodes.split_at_mut(middle);
    let high = &mut rest[1..];
    if low.len() > LARGE {
        rayon::join(|| build(low), || build(high));
    } else {
        build(low);
        build(high);
    }
}

/// Put the nodes other than `id` that are nearest to `x` into `best`, ascending.
fn search(nodes: &[Node], x: &[f64; 3], id: u32, best: &mut [Neighbour; NEIGHBOURS]) {
    if nodes.len() <= LEAF {
        nodes.iter().for_each(|node| offer(node, x, id, best));
        return;
    }
    let (low, rest) = nodes.split_at(nodes.len() / 2);
    let node = &rest[0];
    offer(node, x, id, best);
    let axis = usize::from(node.axis);
    let off = x[axis] - node.x[axis];
    let (near, far) = if off < 0.0 { (low, &rest[1..]) } else { (&rest[1..], low) };
    search(near, x, id, best);
    // Rounding is monotonic: nothing on the far side computes to less.
    if off * off < best[NEIGHBOURS - 1].squared {
        search(far, x, id, best);
    }
}

fn offer(node: &Node, x: &[f64; 3], id: u32, best: &mut [Neighbour; NEIGHBOURS]) {
    if node.id == id {
        return;
    }
    let squared = (0..3).map(|a| (node.x[a] - x[a]) * (node.x[a] - x[a])).sum();
    let mut offered = Neighbour { squared, index: node.id };
    for best in best {
        if offered.squared < best.squared {
            core::mem::swap(&mut offered, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn naive(points: &[[f64; 3]]) -> Vec<f64> {
        let squared = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>();
        let of = |i: usize| {
            let others = points.iter().enumerate().filter(|(j, _)| *j != i);
            let mut d: Vec<f64> = others.map(|(_, x)| squared(x, &points[i])).collect();
            d.sort_unstable_by(f64::total_cmp);
            d.truncate(3);
            d.iter().sum::<f64>() / d.len().max(1) as f64
        };
        (0..points.len()).map(of).collect()
    }

    proptest! {
        #![proptest_config(testkit::property::cases(96))]

        #[test]
        fn distances_match_naive(
            // A coarse lattice, so that coordinates repeat, or a fine one.
            cells in prop_oneof![Just(3_u32), Just(1_000_000)],
            raw in prop::collection::vec(prop::array::uniform3(0_u32..1_000_000), 0..200),
            shape in prop::array::uniform3(0_u32..2),
            far in prop::bool::ANY,
        ) {
            let mut points: Vec<[f64; 3]> = raw
                .iter()
                .map(|x| [0, 1, 2].map(|a| f64::from(shape[a] * (x[a] % cells)) / f64::from(cells)))
                .collect();
            if far && !points.is_empty() {
                points[0] = [1e6, -1e6, 1e6];
            }
            prop_assert_eq!(mean_squared_distances(&points), naive(&points));
        }
    }

    #[test]
    fn the_nearest_of_a_place_are_those_of_a_search_one_by_one() {
        let u = field_core::rng::Rng::new(4, 0);
        let at = |i: u64| u.uniform4_at(i).map(f64::from);
        let points: Vec<[f64; 3]> = (0..500).map(|i| [at(i)[0], at(i)[1], at(i)[2]]).collect();
        let tree = Neighbours::new(&points);
        for k in 1000..1040 {
            let x = [at(k)[0], at(k)[1], at(k)[2]];
            let mut all: Vec<(f64, u32)> =
                (0..).zip(&points).map(|(i, p)| ((0..3).map(|a| (p[a] - x[a]) * (p[a] - x[a])).sum(), i)).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let found: Vec<(f64, u32)> = tree.nearest(&x).map(|found| (found.squared, found.index)).collect();
            assert_eq!(found, all[..NEIGHBOURS]);
        }
        let of = |n: usize| Neighbours::new(&points[..n]).nearest(&[0.5; 3]).count();
        assert_eq!([of(0), of(1), of(2), of(3)], [0, 1, 2, 3]);
    }

    #[test]
    fn large_clouds_match_naive_and_threads_do_not_change_a_bit() {
        let u = field_core::rng::Rng::new(3, 0);
        let points: Vec<[f64; 3]> = (0..12_000)
            .map(|i| {
                let [x, y, z, _] = u.uniform4_at(i).map(f64::from);
                // A surface, as points of photos are.
                [x, y, 0.01 * z + (5.0 * x).sin()]
            })
            .collect();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| mean_squared_distances(&points))
        };
        let one = on(1);
        assert!(on(2) == one && on(7) == one);
        assert!(one == naive(&points));
    }

    #[test]
    fn many_points_at_one_place_are_at_distance_zero() {
        let mut points = vec![[0.25, -1.0, 3.0]; 10_000];
        points.push([0.25, -1.0, 5.0]);
        let d = mean_squared_distances(&points);
        assert!(d[..10_000].iter().all(|d| *d == 0.0));
        assert_eq!(d[10_000], 4.0);
    }

    #[test]
    fn fewer_than_four_points_take_the_others_there_are() {
        assert!(mean_squared_distances(&[]).is_empty());
        assert_eq!(mean_squared_distances(&[[1.0; 3]]), [0.0]);
        assert_eq!(mean_squared_distances(&[[0.0; 3], [2.0, 0.0, 0.0]]), [4.0, 4.0]);
        assert_eq!(mean_squared_distances(&[[0.0; 3], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [2.5, 4.5, 3.0]);
    }
}
