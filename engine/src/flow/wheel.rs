//! The colour wheel of Middlebury: flow vectors as colours.
//!
//! Six runs of hues, each from one corner of the colour cube to the next; a run has as many steps as eyes tell hues apart there:
//!
//! ```text
//! red -15-> yellow -6-> green -4-> cyan -11-> blue -13-> magenta -6-> red
//! place = (1 + atan2(-y, -x) / pi) / 2 * 54       right is red, down yellow, left cyan, up violet
//! colour = 1 - r (1 - hue(place))                 r: length over the full length; white stands still
//! ```
//!
//! What is longer than the full length has its hue at three quarters of its brightness.
//!
//! Source: Baker, Scharstein, Lewis, Roth, Black, Szeliski, "A database and evaluation methodology for optical flow", 2011, section 4.1,
//! and the code beside it, whose wheel leaves a sixth of the last run out between its end and red.

use losses::metrics::quantise_value;

/// Steps of each run, and the corners that it goes from and to.
const RUNS: [(usize, [f32; 3], [f32; 3]); 6] = [
    (15, [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]),
    (6, [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]),
    (4, [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]),
    (11, [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]),
    (13, [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]),
    (6, [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]),
];
/// Steps of the whole wheel.
const STEPS: usize = 55;
/// Brightness of what is longer than the full length.
const BEYOND: f32 = 0.75;

/// Hue of a step of the wheel.
fn hue(step: usize) -> [f32; 3] {
    let mut left = step % STEPS;
    for (steps, from, to) in RUNS {
        if left < steps {
            let share = left as f32 / steps as f32;
            return [0, 1, 2].map(|c| from[c] + share * (to[c] - from[c]));
        }
        left -= steps;
    }
    // Not reached: the runs have as many steps as the wheel.
    RUNS[0].1
}

/// Colour of a flow vector, x to the right, y down, where `full` is the length of the fullest colour, in the same unit and above 0.
pub(super) fn colour([x, y]: [f32; 2], full: f32) -> [u8; 3] {
    let length = x.hypot(y) / full;
    let place = 0.5 * (1.0 + (-y).atan2(-x) / std::f32::consts::PI) * (STEPS - 1) as f32;
    // What goes level to the right lies where the wheel begins, whatever the sign of its 0.
    let place = if y == 0.0 && x > 0.0 { 0.0 } else { place };
    let step = place as usize;
    let (before, after, share) = (hue(step), hue(step + 1), place - step as f32);
    [0, 1, 2].map(|c| {
        let hue = before[c] + share * (after[c] - before[c]);
        quantise_value(if length <= 1.0 { 1.0 - length * (1.0 - hue) } else { BEYOND * hue })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The wheel as its code writes it down: 55 colours of 8 bits, each run by a line of its own.
    fn written_down() -> Vec<[f64; 3]> {
        let part = |i: u32, n: u32| (255.0 * f64::from(i) / f64::from(n)).floor();
        let mut out = Vec::new();
        out.extend((0..15).map(|i| [255.0, part(i, 15), 0.0]));
        out.extend((0..6).map(|i| [255.0 - part(i, 6), 255.0, 0.0]));
        out.extend((0..4).map(|i| [0.0, 255.0, part(i, 4)]));
        out.extend((0..11).map(|i| [0.0, 255.0 - part(i, 11), 255.0]));
        out.extend((0..13).map(|i| [part(i, 13), 0.0, 255.0]));
        out.extend((0..6).map(|i| [255.0, 0.0, 255.0 - part(i, 6)]));
        out
    }

    #[test]
    fn the_wheel_is_the_one_that_is_written_down() {
        let wheel = written_down();
        assert_eq!((wheel.len(), RUNS.iter().map(|run| run.0).sum::<usize>()), (STEPS, STEPS));
        for (step, want) in wheel.iter().enumerate() {
            for (got, want) in hue(step).into_iter().zip(want) {
                assert!((f64::from(got) * 255.0 - want).abs() < 1.001, "step {step}: {got} for {want}");
            }
        }
        assert_eq!((hue(STEPS), hue(0)), ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]));
    }

    #[test]
    fn colours_of_vectors_are_those_of_the_formula() {
        let wheel = written_down();
        for degrees in (1..360).step_by(7) {
            for length in [0.0, 0.3, 1.0, 1.7] {
                let angle = f64::from(degrees).to_radians();
                let (x, y) = (length * angle.cos(), length * angle.sin());
                let place = (1.0 + (-y).atan2(-x) / std::f64::consts::PI) / 2.0 * 54.0;
                let at = place.floor() as usize;
                let r = x.hypot(y);
                let got = colour([4.0 * x as f32, 4.0 * y as f32], 4.0);
                for (c, got) in got.map(f64::from).into_iter().enumerate() {
                    let hue = (1.0 - place.fract()) * wheel[at][c] + place.fract() * wheel[(at + 1) % STEPS][c];
                    let [within, beyond] = [255.0 - r * (255.0 - hue), 0.75 * hue].map(|want| (got - want).abs() < 2.0);
                    // Where the length is all but full, rounding says on which side it is.
                    let ok = match r - 1.0 {
                        more if more.abs() < 1e-5 => within || beyond,
                        more if more < 0.0 => within,
                        _ => beyond,
                    };
                    assert!(ok, "{degrees} degrees, length {length}, channel {c}: {got}");
                }
            }
        }
    }

    #[test]
    fn what_stands_still_is_white_and_directions_have_the_colours_that_people_know() {
        assert_eq!([colour([0.0; 2], 1.0), colour([-0.0; 2], 1.0)], [[255; 3]; 2]);
        let right = [colour([1.0, 0.0], 1.0), colour([1.0, -0.0], 1.0)];
        assert_eq!(right, [[255, 0, 0]; 2]);
        let [down, left, up] = [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].map(|v| colour(v, 1.0));
        assert!(down[0] == 255 && down[1] > 220 && down[2] == 0, "yellow: {down:?}");
        assert!(left[0] == 0 && left[1] > 190 && left[2] == 255, "cyan: {left:?}");
        assert!(up[1] == 0 && up[2] == 255 && (60..130).contains(&up[0]), "violet: {up:?}");
        // Half of the length is half way to white, more than all of it darker.
        assert_eq!([colour([0.5, 0.0], 1.0), colour([7.0, 0.0], 1.0)], [[255, 128, 128], [191, 0, 0]]);
        assert_eq!(colour([f32::NAN; 2], 1.0), [0; 3]);
    }
}
