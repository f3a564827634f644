//! What a system that bears a paper's name does otherwise than the paper.
//!
//! Said once, beside each name where systems are listed ([`crate::registry::CLAIMS`], [`crate::wild::CLAIMS`],
//! [`crate::dynamic::CLAIMS`]). From there it goes into `--help`, the lines of the plan, the tables of `nerf-bench`; README and
//! documents are compared with it by tests.

use engine::system::SystemError;

/// A system's name, and how far it is the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Claim {
    /// Name on the command line.
    pub name: &'static str,
    /// The paper that it is named after; empty where the name is nobody's.
    pub paper: &'static str,
    /// What differs from the paper, a sentence or two; of systems without one, what they are.
    pub differs: &'static str,
    /// The same in a few words, for rows of tables; empty without a paper.
    pub mark: &'static str,
}

impl Claim {
    /// Whether the name is a paper's.
    #[must_use]
    pub fn is_of_a_paper(&self) -> bool {
        !self.paper.is_empty()
    }

    /// A line of a plan; `None` where the name is no paper's.
    #[must_use]
    pub fn line(&self) -> Option<String> {
        self.is_of_a_paper().then(|| format!("not all as published ({}): {}", self.paper, self.differs))
    }
}

/// The names of some systems.
pub(crate) const fn names<const N: usize>(claims: &[Claim; N]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut i = 0;
    while i < N {
        names[i] = claims[i].name;
        i += 1;
    }
    names
}

/// The claim of a name.
///
/// # Errors
/// [`SystemError::Config`] that lists the names there are.
pub(crate) fn claim(claims: &[Claim], name: &str) -> Result<Claim, SystemError> {
    let found = claims.iter().find(|claim| claim.name == name);
    found.copied().ok_or_else(|| crate::settings::no_such_system(name, claims.iter().map(|claim| claim.name)))
}

/// The claim of a system's name: of those for scenes that stand still, from the wild, or that move. `ngp` is the same everywhere.
#[must_use]
pub fn find(name: &str) -> Option<Claim> {
    let all = crate::registry::CLAIMS.iter().chain(&crate::wild::CLAIMS).chain(&crate::dynamic::CLAIMS);
    all.copied().find(|claim| claim.name == name)
}

/// All systems as text for `--help`: a name a line, what differs below.
#[must_use]
pub fn listing(claims: &[Claim]) -> String {
    let entry = |claim: &Claim| match claim.is_of_a_paper() {
        true => format!("{} ({}). Differs: {}", claim.name, claim.paper, claim.differs),
        false => format!("{}: {}", claim.name, claim.differs),
    };
    claims.iter().map(entry).collect::<Vec<_>>().join("\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made::{Points, capture};
    use engine::options::RunOptions;

    /// Names that are no paper's.
    const OWN: [&str; 2] = ["auto", "plain"];

    fn all() -> impl Iterator<Item = Claim> {
        crate::registry::CLAIMS.into_iter().chain(crate::wild::CLAIMS).chain(crate::dynamic::CLAIMS)
    }

    #[test]
    fn every_system_with_a_paper_s_name_says_what_differs_in_a_sentence_or_two() {
        for claim in all() {
            assert_eq!(claim.is_of_a_paper(), !OWN.contains(&claim.name), "{}", claim.name);
            assert!(claim.differs.ends_with('.'), "{}: {}", claim.name, claim.differs);
            let sentences = claim.differs.matches(". ").count() + 1;
            assert!(sentences <= 3 && claim.differs.len() <= 420, "{}: {}", claim.name, claim.differs);
            if claim.is_of_a_paper() {
                assert!((5..60).contains(&claim.mark.len()), "{}: {}", claim.name, claim.mark);
                assert!(claim.line().unwrap().contains(claim.differs));
            }
        }
        assert_eq!(find("hugs").unwrap().name, "hugs");
        assert!(find("nerfstudio").is_none());
    }

    #[test]
    fn plans_say_it_where_the_system_starts() {
        let (scene, data) = capture(Points::WithTracks);
        let run = |set: &str| RunOptions { seed: 0, background: None, error_budget: None, set: set.parse().unwrap() };
        let mut seen = 0;
        let mut check = |claim: Claim, lines: &[String]| {
            seen += 1;
            match claim.line() {
                Some(line) => assert!(lines.contains(&line), "{}: {lines:#?}", claim.name),
                None => assert!(!lines.iter().any(|l| l.contains("as published (")), "{}: {lines:#?}", claim.name),
            }
        };
        for claim in crate::registry::CLAIMS {
            check(claim, &crate::registry::build(claim.name, &scene, &data, &run("")).unwrap().1.lines);
        }
        for claim in crate::wild::CLAIMS {
            // What `auto` takes is told to it: looking takes a training.
            let set = if claim.name == "auto" { "appearance = 'none'\noccluders = 'none'" } else { "" };
            check(claim, &crate::wild::build(claim.name, &scene, &data, &run(set)).unwrap().1.lines);
        }
        for claim in crate::dynamic::CLAIMS {
            check(claim, &crate::dynamic::build(claim.name, &scene, &data, &run("")).unwrap().1.lines);
        }
        assert_eq!(seen, all().count());
    }
}
