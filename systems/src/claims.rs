//! What a system that bears a paper's name does otherwise than the paper.
//!
//! Said once, in the system's file. From there it goes into `--help`, the README, the lines of the plan and the tables of
//! `nerf-bench`; documents are compared with it by tests.

/// A system's name, and how far it is the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Claim {
    /// Name on the command line.
    pub name: &'static str,
    /// The paper that it is named after; empty where the name is not from a paper.
    pub paper: &'static str,
    /// What it is, in a few words.
    pub what: &'static str,
    /// When to take it, in a few words.
    pub take: &'static str,
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

    /// A line of a plan; `None` where the name is not from a paper.
    #[must_use]
    pub fn line(&self) -> Option<String> {
        self.is_of_a_paper().then(|| format!("not all as published ({}): {}", self.paper, self.differs))
    }
}

/// Systems as text for `--help`: a paragraph each, with what differs.
#[must_use]
pub fn listing(claims: impl IntoIterator<Item = Claim>) -> String {
    let entry = |claim: Claim| match claim.is_of_a_paper() {
        true => format!("{} ({}). Differs: {}", claim.name, claim.paper, claim.differs),
        false => format!("{}: {}", claim.name, claim.differs),
    };
    claims.into_iter().map(entry).collect::<Vec<_>>().join("\n\n")
}
