//! Every level agrees with scalar arithmetic; vector functions stay within their stated error.
use float_core::{MAX_LANES, Simd, Task, Vector, vecmath};

struct Map<'a, F>(&'a [f32], &'a mut [f32], F);
trait Op {
    fn apply<V: Vector>(x: V) -> V;
}
impl<F: Op> Task for Map<'_, F> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for (x, y) in self.0.chunks_exact(V::LANES).zip(self.1.chunks_exact_mut(V::LANES)) {
            F::apply(V::load(x)).store(y);
        }
    }
}
struct Exp;
impl Op for Exp {
    #[inline(always)]
    fn apply<V: Vector>(x: V) -> V {
        vecmath::exp(x)
    }
}
struct Logistic;
impl Op for Logistic {
    #[inline(always)]
    fn apply<V: Vector>(x: V) -> V {
        vecmath::logistic(x)
    }
}
struct Mixed;
impl Op for Mixed {
    #[inline(always)]
    fn apply<V: Vector>(x: V) -> V {
        let two = V::splat(2.0);
        (-x).min(two).max(V::splat(-3.0)) + x.floor() * two - x.round()
            + x.select_positive(x * x, x / two).sqrt().max(V::splat(0.0))
    }
}

fn ulps(got: f32, want: f64) -> f64 {
    let w = want as f32;
    let ulp = (f32::from_bits(w.to_bits() + 1) - w) as f64;
    (got as f64 - want).abs() / ulp
}

fn sweep() -> Vec<f32> {
    let n = 1 << 20;
    (0..n).map(|i| -86.9 + 174.8 * i as f32 / n as f32).collect()
}

#[test]
fn exp_stays_within_two_ulp_at_every_level() {
    let x = sweep();
    let mut y = vec![0.0; x.len()];
    for level in Simd::available() {
        level.run(Map(&x, &mut y, Exp));
        let worst = x.iter().zip(&y).map(|(&x, &y)| ulps(y, (x as f64).exp())).fold(0.0, f64::max);
        println!("exp {:?}: {worst:.3} ulp", level.level());
        assert!(worst <= 2.0, "{:?}: {worst} ulp", level.level());
    }
}

#[test]
fn logistic_stays_within_four_ulp_at_every_level() {
    let x = sweep();
    let mut y = vec![0.0; x.len()];
    for level in Simd::available() {
        level.run(Map(&x, &mut y, Logistic));
        let worst = x.iter().zip(&y).map(|(&x, &y)| ulps(y, 1.0 / (1.0 + (-x as f64).exp()))).fold(0.0, f64::max);
        println!("logistic {:?}: {worst:.3} ulp", level.level());
        assert!(worst <= 4.0, "{:?}: {worst} ulp", level.level());
    }
}

#[test]
fn exp_is_finite_for_every_finite_or_infinite_argument() {
    let x: Vec<f32> = [f32::MIN, -1e30, -200.0, -0.0, 0.0, 1e-40, 200.0, f32::MAX, f32::INFINITY, f32::NEG_INFINITY]
        .into_iter()
        .cycle()
        .take(32)
        .collect();
    let mut y = vec![0.0; 32];
    for level in Simd::available() {
        level.run(Map(&x, &mut y, Exp));
        assert!(y.iter().all(|y| y.is_finite() && *y >= 0.0), "{y:?}");
    }
}

#[test]
fn levels_agree_on_lane_operations_bit_for_bit() {
    let x: Vec<f32> = (0..64).map(|i| (i as f32 - 31.0) * 0.37).collect();
    let mut want = vec![0.0; 64];
    Simd::SCALAR.run(Map(&x, &mut want, Mixed));
    for level in Simd::available() {
        let mut got = vec![0.0; 64];
        level.run(Map(&x, &mut got, Mixed));
        for (g, w) in got.iter().zip(&want) {
            assert!(g == w || (g.is_nan() && w.is_nan()), "{:?}: {g} {w}", level.level());
        }
    }
}

struct Gather<'a>(&'a [f32], &'a [u32]);
impl Task for Gather<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        self.1.chunks_exact(V::LANES).map(|i| V::gather(self.0, i).sum()).sum()
    }
}

#[test]
fn gather_reads_what_it_should_and_refuses_the_rest() {
    let table: Vec<f32> = (0..100).map(|i| i as f32).collect();
    let index: Vec<u32> = (0..32).map(|i| (i * 37) % 100).collect();
    let want: f32 = index.iter().map(|&i| table[i as usize]).sum();
    for level in Simd::available() {
        assert_eq!(level.run(Gather(&table, &index)), want);
        let bad = vec![100_u32; 16];
        assert!(std::panic::catch_unwind(|| level.run(Gather(&table, &bad))).is_err());
    }
}

struct Parts<'a>(&'a [f32], &'a mut [f32]);
impl Task for Parts<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        let x = V::load_part(self.0);
        // Lanes past the slice are 0.
        let mut all = [f32::NAN; MAX_LANES];
        x.store(&mut all);
        let count = self.0.len().min(V::LANES);
        assert_eq!(all[..count], self.0[..count]);
        assert!(all[count..V::LANES].iter().all(|x| *x == 0.0), "{all:?}");
        x.store_part(self.1);
        V::LANES
    }
}

#[test]
fn parts_of_vectors_are_filled_with_zeros_and_stored_as_far_as_there_is_room() {
    let x: Vec<f32> = (0..20).map(|i| i as f32 + 1.0).collect();
    for level in Simd::available() {
        for len in 0..=x.len() {
            for room in 0..=x.len() {
                let mut out = vec![-1.0; room];
                let lanes = level.run(Parts(&x[..len], &mut out));
                for (i, out) in out.iter().enumerate() {
                    let want = if i >= lanes { -1.0 } else { x[..len].get(i).copied().unwrap_or(0.0) };
                    assert_eq!(*out, want, "{:?}, {len} numbers, room for {room}, lane {i}", level.level());
                }
            }
        }
    }
}

/// In a process of its own: the cap holds for all of it.
#[test]
#[cfg_attr(miri, ignore = "Miri starts no processes")]
fn a_cap_lowers_the_best_level_and_nothing_else() {
    const CHILD: &str = "FLOAT_CORE_TEST_CAP";
    if std::env::var_os(CHILD).is_none() {
        let mut child = std::process::Command::new(std::env::current_exe().unwrap());
        child.args(["--exact", "a_cap_lowers_the_best_level_and_nothing_else", "--nocapture"]);
        let out = child.env(CHILD, "1").output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(String::from_utf8_lossy(&out.stdout).contains("1 passed"));
        return;
    }
    let all: Vec<Simd> = Simd::available().collect();
    let fastest = Simd::best();
    assert_eq!(all.last(), Some(&fastest));
    for &simd in &all {
        Simd::cap_best(simd.level());
        assert_eq!(Simd::best(), simd);
        assert!(Simd::available().eq(all.iter().copied()) && fastest.level() >= simd.level());
    }
}

struct Positive<'a>(&'a [f32]);

impl Task for Positive<'_> {
    type Output = Vec<bool>;
    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<bool> {
        let lanes = |x: &[f32]| {
            let bits = V::load(x).positive();
            (0..V::LANES).map(move |lane| bits >> lane & 1 == 1).collect::<Vec<bool>>()
        };
        self.0.chunks_exact(V::LANES).flat_map(lanes).collect()
    }
}

#[test]
fn lanes_above_zero_are_bits() {
    let mut x = sweep();
    x.extend([0.0, -0.0, f32::NAN, -f32::NAN, 1e-45, -1e-45, f32::INFINITY, f32::NEG_INFINITY]);
    x.rotate_right(5);
    x.truncate(x.len() / 16 * 16);
    let want: Vec<bool> = x.iter().map(|&x| x > 0.0).collect();
    for simd in Simd::available() {
        assert_eq!(simd.run(Positive(&x)), want, "{:?}", simd.level());
    }
}
