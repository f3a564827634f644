//! Points of a tile on the tape, before and after they are moved.

use field_core::tape::{Node, Tape, TapeError};

/// Points of a tile at most.
pub(super) const TILE: usize = 480;

/// The time `t = 0` of each point of a tile, in `[-1, 1]`.
static BEGINNING: [f32; TILE] = [-1.0; TILE];

/// Whether points of a tile move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moves {
    /// Any of them may.
    Yes,
    /// None does: they are of the canonical time.
    No,
}

/// Points of a tile at their times.
#[derive(Clone, Copy, Debug)]
pub(crate) struct At<'t> {
    /// `[3 x n]` in the cube `[-1, 1]^3`: encodings and rotations are about the middle of the scene.
    pub(crate) x: Node,
    /// `[dims x n]`, the time as networks see it: `gamma(t)`, `MLP(gamma(t))` or a free code.
    pub(crate) time: Node,
    /// `[n]`, the time itself in `[-1, 1]`, for what has an axis of time.
    pub(crate) t: &'t [f32],
    /// Whether points move.
    pub(crate) moves: Moves,
    /// `[dims x n]`, `t = 0` as networks see it; only where points move and the canonical scene is tied to that time.
    pub(crate) origin: Option<Node>,
}

impl At<'_> {
    /// The same points at `t = 0`, where the canonical scene is tied to that time.
    fn at_origin(&self) -> Option<Self> {
        let time = self.origin?;
        Some(Self { x: self.x, time, t: &BEGINNING[..self.t.len()], moves: self.moves, origin: None })
    }
}

/// What a network says of points at their time, `now`, less what it says of them at `t = 0` where the canonical scene is tied to that
/// time: nothing at `t = 0`, and next to nothing beside it.
///
/// # Errors
/// [`TapeError`] for other shapes.
pub(crate) fn since_origin<'a>(
    tape: &mut Tape<'a>,
    at: &At<'_>,
    now: Node,
    says: impl FnOnce(&mut Tape<'a>, &At<'_>) -> Result<Node, TapeError>,
) -> Result<Node, TapeError> {
    let Some(origin) = at.at_origin() else { return Ok(now) };
    let then = says(tape, &origin)?;
    tape.sub(now, then)
}

/// Points that have been moved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    /// Canonical points, `[3 x n]` in the cube `[-1, 1]^3`; `None`: they stay where they are.
    pub(crate) x: Option<Node>,
    /// What the density network sees besides features of the canonical point, `[rows x n]`; `None`: nothing.
    pub(crate) seen: Option<Node>,
}

impl Moved {
    /// Canonical points, and what is seen besides, one matrix above the other.
    pub(crate) fn new(tape: &mut Tape<'_>, x: Option<Node>, seen: &[Node]) -> Result<Self, TapeError> {
        let seen = match *seen {
            [] => None,
            [one] => Some(one),
            _ => Some(tape.concat(seen)?),
        };
        Ok(Self { x, seen })
    }
}
