//! What was planned beside what was measured.

use super::entry::{Aim, Entry};
use super::measured::Measured;
use crate::goals::Goal;

/// A training of so many seconds ends with the step in which they are over.
const STEP_SECONDS: f64 = 1.0;

/// A goal where everything it compares was measured; `before` are the rows above.
pub(super) fn goal(aim: Aim, scene: &str, entry: &Entry, measured: &Measured, before: &[Measured]) -> Option<Goal> {
    let row = |name: &str| before.iter().find(|m| m.name == name);
    let whole = || row(entry.without?);
    let (what, unit, figure, target) = match aim {
        Aim::Moving(other, least) => {
            let figure = measured.motion.psnr_moving? - row(other)?.motion.psnr_moving?;
            (format!("things that move, above `{other}`"), "dB", figure, least)
        }
        Aim::Over(other, least) => (format!("above `{other}`"), "dB", measured.psnr? - row(other)?.psnr?, least),
        Aim::Faster(other, least) => {
            let other_row = row(other)?;
            let figure = faster(measured, other_row)?;
            (format!("times as fast to the last PSNR of `{other}`"), "x", figure, least)
        }
        Aim::Rays(least) => ("rays".into(), "1/s", measured.rays_per_s?, least),
        Aim::Within { seconds, psnr } => {
            let mut in_time = measured.curve.iter().filter(|p| p.seconds <= seconds + STEP_SECONDS);
            // The best of a curve would be a stop chosen on test views.
            let last = in_time.next_back()?;
            (format!("within {seconds} s, after {:.0} s", last.seconds), "dB", last.psnr, psnr)
        }
        Aim::Costs(least) => {
            let figure = whole()?.psnr? - measured.psnr?;
            if figure == 0.0 {
                // The same picture to the last bit: the part has nothing to do here, say no points to hold in place.
                return None;
            }
            ("cost of the part".into(), "dB", figure, least)
        }
        Aim::HiddenCosts(least) => {
            let figure = whole()?.motion.psnr_hidden? - measured.motion.psnr_hidden?;
            ("cost of the part, what was hidden".into(), "dB", figure, least)
        }
        Aim::DepthCosts(least) => {
            let figure = measured.motion.depth_hidden? / whole()?.motion.depth_hidden?;
            ("error of depth of what was hidden, against the whole".into(), "x", figure, least)
        }
    };
    Some(Goal {
        work: format!("{scene}, {}: {what}", entry.name),
        unit,
        figure,
        target,
        ceiling: None,
        peer: None,
        error: "the figure is one".into(),
    })
}

/// The other's training time over the time after which this one was first seen to be as good as it was at its end; 0 where it
/// never was.
fn faster(measured: &Measured, other: &Measured) -> Option<f64> {
    let last = other.curve.last()?;
    let reached = measured.curve.iter().find(|p| p.psnr >= last.psnr);
    Some(reached.map_or(0.0, |p| last.seconds / p.seconds))
}

#[cfg(test)]
mod tests {
    use super::super::protocols::WORKBENCH;
    use super::*;
    use crate::sections::scene::Point;
    use engine::eval::MotionScore;

    fn row(name: &'static str, psnr: f64, moving: f64, curve: &[(f64, f64)]) -> Measured {
        Measured {
            name,
            psnr: Some(psnr),
            motion: MotionScore {
                psnr_moving: Some(moving),
                psnr_hidden: Some(moving),
                depth_hidden: Some(1.0 / moving),
                ..MotionScore::default()
            },
            rays_per_s: Some(2e4),
            curve: curve.iter().map(|&(seconds, psnr)| Point { step: 1, seconds, psnr }).collect(),
            ..Measured::default()
        }
    }

    #[test]
    fn aims_are_compared_with_what_they_are_about() {
        let before = [
            row("ngp", 20.0, 16.0, &[]),
            row("d-nerf", 29.0, 24.0, &[(10.0, 20.0), (200.0, 29.0)]),
            row("nerfies", 28.0, 20.0, &[]),
        ];
        let own = row("own", 28.5, 25.0, &[(10.0, 28.0), (16.0, 29.5), (700.0, 31.0)]);
        let entry = Entry { without: Some("nerfies"), ..WORKBENCH.entries[0] };
        let of = |aim| goal(aim, "g", &entry, &own, &before).map(|g| (g.figure, g.target));
        assert_eq!(of(Aim::Moving("ngp", 8.0)), Some((9.0, 8.0)));
        assert_eq!(of(Aim::Over("d-nerf", 0.0)), Some((-0.5, 0.0)));
        assert_eq!(of(Aim::Faster("d-nerf", 10.0)), Some((12.5, 10.0)));
        assert_eq!(of(Aim::Rays(1e4)), Some((2e4, 1e4)));
        assert_eq!(
            of(Aim::Within { seconds: 600.0, psnr: 30.0 }),
            Some((29.5, 30.0)),
            "what came later does not count"
        );
        let falling = row("own", 28.5, 25.0, &[(10.0, 28.0), (16.0, 31.0), (200.0, 27.0)]);
        let within = goal(Aim::Within { seconds: 600.0, psnr: 30.0 }, "g", &entry, &falling, &before);
        assert_eq!(within.map(|g| g.figure), Some(27.0), "the last of a curve counts, not the best");
        assert_eq!(of(Aim::Costs(0.0)), Some((-0.5, 0.0)));
        let idle = goal(Aim::Costs(0.0), "g", &entry, &row("own", 28.0, 25.0, &[]), &before);
        assert!(idle.is_none(), "a part that does nothing here costs nothing, and that is not a merit");
        assert_eq!(of(Aim::HiddenCosts(0.0)), Some((-5.0, 0.0)));
        assert_eq!(of(Aim::DepthCosts(1.0)).map(|(x, _)| (x * 100.0).round()), Some(80.0));
        assert_eq!(of(Aim::Over("absent", 0.0)), None, "nothing to compare with");
        let slow = row("own", 28.5, 25.0, &[(200.0, 28.9)]);
        assert_eq!(faster(&slow, &before[1]), Some(0.0));
        assert_eq!(faster(&own, &before[0]), None);
    }
}
