//! Patches of one picture found in the other, and a flow for each pixel of them.

mod grid;
mod template;

use super::field::Field;
use super::plane::Plane;
use grid::Grid;
use template::{Match, Source, Template};

/// Times that patches try what their neighbours found.
const ROUNDS: usize = 2;
/// What a neighbour found is tried where it fits better than this share of the own cost.
const CLEARLY: f32 = 0.9;

/// The flow from `first` to `second`, both of one size, begun at `start`: each patch is searched for, twice tries what its neighbours found,
/// and each pixel takes the mean of what the patches that cover it say.
pub(super) fn patch_flow(first: &Plane, second: &Plane, start: &Field) -> Field {
    let (source, grid) = (Source::new(first), Grid::new(first.width(), first.height()));
    let template = |column: usize, row: usize| {
        let corner = [grid.across.starts[column], grid.down.starts[row]];
        Template::new(&source, corner, [grid.across.side, grid.down.side])
    };
    let mut found = grid.each(|column, row| {
        let begin = start.linear(grid.across.middle(column), grid.down.middle(row));
        template(column, row).search(second, begin)
    });
    for _ in 0..ROUNDS {
        // All from what was known before the round: the order does not matter.
        found = grid.each(|column, row| {
            let own = found[grid.index(column, row)];
            let template = template(column, row);
            let tried = neighbours(&grid, &found, column, row).map(|flow| template.fit(second, flow));
            match tried.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
                Some(other) if other.cost < CLEARLY * own.cost => template.search(second, other.flow),
                _ => own,
            }
        });
    }
    spread(first, second, &grid, &found)
}

/// What the patches left, right, above and below found.
fn neighbours(grid: &Grid, found: &[Match], column: usize, row: usize) -> impl Iterator<Item = [f32; 2]> {
    let places = [
        (column.checked_sub(1), Some(row)),
        (Some(column + 1).filter(|next| *next < grid.columns()), Some(row)),
        (Some(column), row.checked_sub(1)),
        (Some(column), Some(row + 1).filter(|next| *next < grid.down.starts.len())),
    ];
    places.into_iter().filter_map(move |(column, row)| Some(found[grid.index(column?, row?)].flow))
}

/// Each pixel's mean of the flows of the patches that cover it, weighted with `1 / max(1, |I(x + u) - T(x)|)`.
///
/// # Source
/// Kroeger et al., 2016, equation 3.
fn spread(first: &Plane, second: &Plane, grid: &Grid, found: &[Match]) -> Field {
    Field::from_fn(first.width(), first.height(), |x, y| {
        let here = first.at(x, y);
        let (mut sum, mut weights) = ([0.0_f32; 2], 0.0);
        for row in grid.down.covering[y].clone() {
            for column in grid.across.covering[x].clone() {
                let flow = found[grid.index(column, row)].flow;
                let there = second.cubic(x as f32 + flow[0], y as f32 + flow[1]);
                let weight = 1.0 / (there - here).abs().max(1.0);
                sum = [sum[0] + weight * flow[0], sum[1] + weight * flow[1]];
                weights += weight;
            }
        }
        // Every pixel is covered.
        sum.map(|sum| sum / weights)
    })
}
