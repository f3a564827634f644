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

/// The claims of a table of systems, each of which has a `claim`.
macro_rules! claims_of {
    ($known:ident) => {{
        let mut claims = [$known[0].claim; $known.len()];
        let mut i = 1;
        while i < claims.len() {
            claims[i] = $known[i].claim;
            i += 1;
        }
        claims
    }};
}
pub(crate) use claims_of;

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

/// All systems as text for `--help`: a name a line, what differs below.
#[must_use]
pub fn listing(claims: &[Claim]) -> String {
    let entry = |claim: &Claim| match claim.is_of_a_paper() {
        true => format!("{} ({}). Differs: {}", claim.name, claim.paper, claim.differs),
        false => format!("{}: {}", claim.name, claim.differs),
    };
    claims.iter().map(entry).collect::<Vec<_>>().join("\n\n")
}
