//! What was to be reached, what was, and what this machine could give at most.

use crate::error::BenchError;
use crate::table::{Cell, Table, number};

/// One target beside its figure. Higher is better.
#[derive(Clone, Debug)]
pub(crate) struct Goal {
    /// What was measured.
    pub(crate) work: String,
    /// Unit of `figure`, `target`, `ceiling` and `peer`.
    pub(crate) unit: &'static str,
    /// Measured.
    pub(crate) figure: f64,
    /// Aimed at.
    pub(crate) target: f64,
    /// Most that this machine can give by arithmetic, from ceilings measured in the same run.
    pub(crate) ceiling: Option<f64>,
    /// Best other program, measured before on a machine of the class.
    pub(crate) peer: Option<f64>,
    /// The figure's error, in words with a number.
    pub(crate) error: String,
}

/// Goals of a section as a table, `None` without any.
pub(crate) fn table(goals: &[Goal]) -> Result<Option<Table>, BenchError> {
    if goals.is_empty() {
        return Ok(None);
    }
    let mut table = Table::new(
        "goals",
        "Targets: reached where the figure is at least the target. Ceiling: arithmetic over ceilings measured in the same run. \
         Peer: the best other program, measured before on a machine of the class, not in this run.",
        &[
            "work",
            "unit",
            "figure",
            "target",
            "reached",
            "ceiling here",
            "% of ceiling",
            "peer",
            "ratio to peer",
            "error",
        ],
    );
    for g in goals {
        table.row([
            g.work.as_str().into(),
            g.unit.into(),
            g.figure.into(),
            g.target.into(),
            verdict(g).into(),
            g.ceiling.into(),
            g.ceiling.map(|c| 100.0 * g.figure / c).into(),
            g.peer.into(),
            g.peer
                .map(|p| {
                    if g.unit == "dB" {
                        format!("{:+.1} dB", g.figure - p)
                    } else {
                        format!("{}x", number(g.figure / p))
                    }
                })
                .into(),
            Cell::from(g.error.as_str()),
        ])?;
    }
    Ok(Some(table))
}

/// Reached, or by how much not; and whether the machine could give it at all.
fn verdict(g: &Goal) -> String {
    if g.figure >= g.target {
        return "**yes**".into();
    }
    let missing = if g.unit == "dB" {
        format!("{:.1} dB short", g.target - g.figure)
    } else {
        format!("{:.0} %", 100.0 * g.figure / g.target)
    };
    match g.ceiling {
        Some(ceiling) if ceiling < g.target => format!("no ({missing}; above the ceiling of this machine)"),
        _ => format!("no ({missing})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal(figure: f64, target: f64, ceiling: Option<f64>) -> Goal {
        Goal { work: "w".into(), unit: "M/s", figure, target, ceiling, peer: Some(2.0), error: "1e-5".into() }
    }

    #[test]
    fn verdicts_say_how_far_and_whether_it_can_be() {
        assert_eq!(verdict(&goal(5.0, 5.0, None)), "**yes**");
        assert_eq!(verdict(&goal(4.0, 5.0, Some(6.0))), "no (80 %)");
        assert_eq!(verdict(&goal(4.0, 5.0, Some(4.5))), "no (80 %; above the ceiling of this machine)");
        assert_eq!(verdict(&Goal { unit: "dB", ..goal(30.0, 31.0, None) }), "no (1.0 dB short)");
        let text = table(&[goal(4.0, 5.0, Some(8.0))]).unwrap().unwrap().markdown();
        assert!(text.contains("| 50 | 2 | 2x |"), "{text}");
        assert!(table(&[]).unwrap().is_none());
    }
}
