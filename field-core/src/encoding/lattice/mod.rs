//! Features at the vertices of a grid, blended inside its cells: what the hash grid and the dense grid share.

pub(crate) mod cell;
pub(crate) mod features;
pub(crate) mod groups;
pub(crate) mod kernel;

/// How features change inside a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Trilinear: continuous; derivatives jump at cell faces.
    #[default]
    Linear,
    /// Trilinear in `3 f^2 - 2 f^3`: derivatives are continuous too, and 0 at vertices.
    Smoothstep,
}

/// How the vertices of a grid find their entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addressing {
    /// `(x + R (y + R z)) mod entries`: every vertex has its own entry.
    Dense,
    /// `(x xor 2654435761 y xor 805459861 z) mod entries`, a power of two: vertices share entries.
    Hashed,
}

/// Primes of the spatial hash, y and z; that of x is 1.
pub(crate) const PRIMES: [u32; 2] = [2_654_435_761, 805_459_861];

/// Vertices in space and in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lattice {
    /// `p = x * scale + shift` are the coordinates in cells.
    pub(crate) scale: [f32; 3],
    pub(crate) shift: f32,
    /// Largest cell number along each axis.
    pub(crate) last_cell: [f32; 3],
    /// Entries from a vertex to the next along y and z; dense addressing only.
    pub(crate) strides: [u32; 2],
    /// Dense addressing: more than half of the largest index. Hashed: a power of two.
    pub(crate) entries: u32,
    pub(crate) addressing: Addressing,
}
