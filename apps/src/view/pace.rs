//! How large a picture may be so that it is drawn in time: the size is found from the pictures before it.

use scene_io::Size;

/// Seconds that a picture may take while things move.
const TARGET: f64 = 0.085;

/// Longest side of the first picture, pixels: nothing is known of the speed yet.
const FIRST_SIDE: u32 = 64;

/// Shortest longest side, pixels: below it nothing can be made out, however slow the machine.
const LEAST_SIDE: u32 = 40;

/// A picture may have this many times the pixels of the one before.
const GROWTH: f64 = 3.0;

/// Sizes within this share of the last one are not worth a change: a picture whose size jumps is unquiet.
const SAME: f64 = 0.15;

/// Finds sizes for one kind of picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pace {
    /// Seconds a pixel takes, a mean of recent pictures.
    seconds_per_pixel: Option<f64>,
    /// Pixels of the last picture drawn.
    pixels: f64,
    /// Longest side last given, pixels.
    side: u32,
}

impl Pace {
    /// Size of a picture that is drawn in time, at most `full`, of its shape.
    pub(crate) fn size(&mut self, full: Size) -> Size {
        let most = full.longest_side();
        let Some(cost) = self.seconds_per_pixel else {
            return scaled(full, FIRST_SIDE);
        };
        let pixels = (TARGET / cost.max(1e-12)).min(self.pixels * GROWTH);
        let side = (pixels * f64::from(most) / f64::from(full.width.min(full.height).max(1))).sqrt() as u32;
        let side = side.clamp(LEAST_SIDE, most.max(LEAST_SIDE));
        let change = f64::from(side.abs_diff(self.side)) / f64::from(self.side.max(1));
        if change > SAME || side >= most {
            self.side = side;
        }
        scaled(full, self.side)
    }

    /// Learn from a picture.
    pub(crate) fn measured(&mut self, size: Size, seconds: f64) {
        let pixels = size.pixels() as f64;
        if pixels < 1.0 || !seconds.is_finite() {
            return;
        }
        let cost = seconds.max(1e-6) / pixels;
        // Quick to believe that things got slow, slower to believe the opposite: late pictures are what people notice.
        let share = |old: f64| if cost > old { 0.6 } else { 0.3 };
        self.seconds_per_pixel = Some(self.seconds_per_pixel.map_or(cost, |old| old + share(old) * (cost - old)));
        self.pixels = pixels;
    }
}

/// `full` with its longest side at most `side`, at least one pixel each way.
pub(crate) fn scaled(full: Size, side: u32) -> Size {
    let most = full.longest_side().max(1);
    if side >= most {
        return Size::new(full.width.max(1), full.height.max(1));
    }
    let of = |n: u32| ((f64::from(n) * f64::from(side) / f64::from(most)).round() as u32).max(1);
    Size::new(of(full.width), of(full.height))
}

/// Sizes drawn one after the other when the camera rests: from that of `first` doubling to `full`.
pub(crate) fn levels(first: Size, full: Size) -> Vec<Size> {
    let most = full.longest_side();
    let mut side = first.longest_side();
    let mut sizes = Vec::new();
    while side < most {
        // A level that would be nearly the last is the last.
        side = if f64::from(side) * 2.0 > f64::from(most) * 0.7 { most } else { side * 2 };
        sizes.push(scaled(full, side));
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The size after many pictures on a machine with `cost` seconds a pixel and `fixed` seconds a picture.
    fn settled(pace: &mut Pace, full: Size, cost: f64, fixed: f64) -> Size {
        for _ in 0..60 {
            let size = pace.size(full);
            pace.measured(size, fixed + cost * size.pixels() as f64);
        }
        pace.size(full)
    }

    #[test]
    fn sizes_settle_where_a_picture_takes_less_than_a_tenth_of_a_second() {
        for cost in [1e-7, 1e-6, 1e-5, 4e-5] {
            for full in [Size::new(800, 600), Size::new(600, 800), Size::new(1600, 500)] {
                let size = settled(&mut Pace::default(), full, cost, 0.002);
                let seconds = 0.002 + cost * size.pixels() as f64;
                assert!(seconds <= 0.1, "{cost} {full}: {size} takes {seconds}");
                let is_least = size.longest_side() == LEAST_SIDE;
                assert!(size == full || is_least || seconds > 0.05, "{cost} {full}: {size}");
                let shape = |size: Size| f64::from(size.width) / f64::from(size.height);
                assert!((shape(size) / shape(full) - 1.0).abs() < 0.05);
            }
        }
    }

    #[test]
    fn a_machine_that_slows_down_gets_smaller_pictures_and_one_that_recovers_larger_ones() {
        let full = Size::new(800, 800);
        let mut pace = Pace::default();
        let quick = settled(&mut pace, full, 1e-6, 0.0);
        let slow = settled(&mut pace, full, 1e-5, 0.0);
        let again = settled(&mut pace, full, 1e-6, 0.0);
        assert!(slow.width * 2 < quick.width && again.width * 10 > quick.width * 8, "{quick:?} {slow:?} {again:?}");
    }

    #[test]
    fn small_changes_of_speed_leave_the_size_alone() {
        let full = Size::new(800, 600);
        let mut pace = Pace::default();
        let before = settled(&mut pace, full, 5e-6, 0.0);
        for cost in [5.3e-6, 4.8e-6, 5.2e-6] {
            pace.measured(before, cost * before.pixels() as f64);
            assert_eq!(pace.size(full), before);
        }
    }

    #[test]
    fn the_slowest_machine_still_gets_a_picture_and_the_first_is_small() {
        let mut pace = Pace::default();
        assert_eq!(pace.size(Size::new(800, 400)), Size::new(64, 32));
        pace.measured(Size::new(64, 32), 60.0);
        assert_eq!(pace.size(Size::new(800, 400)), Size::new(40, 20));
        assert_eq!(Pace::default().size(Size::new(30, 20)), Size::new(30, 20));
        pace.measured(Size::new(0, 0), 1.0);
        pace.measured(Size::new(3, 3), f64::NAN);
        assert_eq!(pace.size(Size::new(800, 400)), Size::new(40, 20));
    }

    #[test]
    fn levels_double_up_to_the_full_size() {
        let full = Size::new(800, 600);
        assert_eq!(levels(Size::new(100, 75), full), [(200, 150), (400, 300), (800, 600)].map(Size::from));
        assert_eq!(levels(Size::new(300, 225), full), [full]);
        assert_eq!(levels(full, full), []);
    }
}
