//! Settings that are reduced where a limit of memory is too low for those planned.

/// A setting that takes memory, how it is reduced, and below what it is of no use.
struct Knob {
    name: &'static str,
    reduce: fn(i64) -> i64,
    least: i64,
}

/// In the order in which they are tried, over and over: what costs least quality first.
const KNOBS: [Knob; 6] = [
    Knob { name: "max_splats", reduce: |n| n * 4 / 5, least: 1000 },
    Knob { name: "batch_samples", reduce: |n| n / 2, least: 4096 },
    Knob { name: "log2_table", reduce: |n| n - 1, least: 12 },
    Knob { name: "plane_vertices", reduce: |n| n * 4 / 5, least: 16 },
    Knob { name: "voxels", reduce: |n| n * 4 / 5, least: 24 },
    Knob { name: "batch_rays", reduce: |n| n / 2, least: 16 },
];

/// One setting that was reduced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reduced {
    /// Its name.
    pub(crate) name: &'static str,
    /// What it was, and what it is now.
    pub(crate) from: i64,
    /// What it is now.
    pub(crate) to: i64,
}

/// Reduce one setting of `settings` that the user did not choose (`said`); the one that was reduced least often so far. `None`
/// where no setting is left to reduce.
pub fn reduce(settings: &mut toml::Table, said: &toml::Table, before: &[Reduced]) -> Option<Reduced> {
    let times = |knob: &Knob| before.iter().filter(|r| r.name == knob.name).count();
    let open = |knob: &&Knob| {
        let value = settings.get(knob.name).and_then(toml::Value::as_integer);
        !said.contains_key(knob.name) && value.is_some_and(|n| n > knob.least)
    };
    let knob = KNOBS.iter().filter(open).min_by_key(|knob| times(knob))?;
    let from = settings.get(knob.name)?.as_integer()?;
    let to = (knob.reduce)(from).max(knob.least);
    settings.insert(knob.name.into(), toml::Value::Integer(to));
    Some(Reduced { name: knob.name, from, to })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_reduced_in_turn_down_to_what_is_of_use() {
        let mut settings = toml::toml! { log2_table = 14
        batch_samples = 16384
        lr = 0.01 };
        let mut all = Vec::new();
        while let Some(reduced) = reduce(&mut settings, &toml::Table::new(), &all) {
            all.push(reduced);
        }
        let names: Vec<&str> = all.iter().map(|r| r.name).collect();
        assert_eq!(names, ["batch_samples", "log2_table", "batch_samples", "log2_table"]);
        assert_eq!(settings["log2_table"].as_integer(), Some(12));
        assert_eq!(settings["batch_samples"].as_integer(), Some(4096));
    }

    #[test]
    fn what_the_user_said_stays() {
        let mut settings = toml::toml! { max_splats = 100000 };
        let said = settings.clone();
        assert_eq!(reduce(&mut settings, &said, &[]), None);
        assert_eq!(settings, said);
    }
}
