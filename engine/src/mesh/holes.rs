//! Small holes that photos saw are closed; what no photo saw stays open.

use super::depth::{DepthView, Place};
use super::smooth::relax;
use super::topology::loops;
use glam::DVec3;
use scene_io::export::Mesh;

/// Vertices of a loop at most.
const MOST: usize = 400;
/// Rings of a patch at most.
const RINGS: usize = 12;

/// Close loops no longer than `longest`, world units, in whose middle some photo shows a surface within `reach`. Patches take
/// the form of a skin held by the loop. Returns how many were closed.
pub(super) fn fill(mesh: &mut Mesh, views: &[DepthView], longest: f64, reach: f64) -> usize {
    let first = mesh.vertices.len();
    let mut closed = 0;
    for line in loops(mesh) {
        let at: Vec<DVec3> = line.iter().map(|v| DVec3::from(mesh.vertices[*v as usize])).collect();
        let length: f64 = (0..at.len()).map(|i| at[i].distance(at[(i + 1) % at.len()])).sum();
        if line.len() > MOST || length > longest {
            continue;
        }
        let middle = at.iter().sum::<DVec3>() / at.len() as f64;
        // A crack a cell wide needs no witness.
        let crack = line.len() <= 8;
        if crack || views.iter().any(|view| view.place == Place::Photo && view.shows(middle, reach)) {
            patch(mesh, &line, &at, middle, length);
            closed += 1;
        }
    }
    relax(mesh, first, 30);
    closed
}

/// Rings from the loop to its middle.
fn patch(mesh: &mut Mesh, line: &[u32], at: &[DVec3], middle: DVec3, length: f64) {
    let (n, edge) = (line.len(), length / line.len() as f64);
    let radius = at.iter().map(|x| x.distance(middle)).sum::<f64>() / n as f64;
    let rings = ((radius / edge) as usize).min(RINGS);
    let mut outer: Vec<u32> = line.to_vec();
    for ring in 1..=rings {
        let share = ring as f64 / (rings + 1) as f64;
        let start = mesh.vertices.len() as u32;
        mesh.vertices.extend(at.iter().map(|x| x.lerp(middle, share).to_array()));
        let inner: Vec<u32> = (start..start + n as u32).collect();
        for i in 0..n {
            let j = (i + 1) % n;
            // The loop runs with the triangles outside of the hole: those inside run against it.
            mesh.triangles.push([outer[j], outer[i], inner[i]]);
            mesh.triangles.push([outer[j], inner[i], inner[j]]);
        }
        outer = inner;
    }
    let centre = mesh.vertices.len() as u32;
    mesh.vertices.push(middle.to_array());
    mesh.triangles.extend((0..n).map(|i| [outer[(i + 1) % n], outer[i], centre]));
}

#[cfg(test)]
mod tests {
    use super::super::tests::{all_around, sphere};
    use super::*;
    use scene_io::export::{MeshGrid, marching_cubes};

    #[test]
    fn a_hole_that_photos_saw_is_closed_and_one_that_they_did_not_see_is_not() {
        let grid = MeshGrid::cubic([-1.3; 3], [1.3; 3], 40);
        let ball = marching_cubes(&grid, 0.0, |points, out| {
            points.iter().zip(out).for_each(|(p, out)| *out = 1.0 - DVec3::from(*p).length() as f32);
        })
        .unwrap();
        let without = |keep: &dyn Fn(DVec3) -> bool| {
            let mut mesh = ball.clone();
            mesh.triangles.retain(|t| t.iter().all(|v| keep(DVec3::from(ball.vertices[*v as usize]))));
            mesh
        };
        let views = all_around(&sphere(1.0), 12, 32);
        let mut holed = without(&|x| x.z < 0.95);
        assert!(holed.open_edges() > 8);
        assert_eq!(fill(&mut holed.clone(), &views, 0.5, 0.2), 0, "too long");
        assert_eq!(fill(&mut holed.clone(), &[], 9.0, 0.2), 0, "not seen");
        assert_eq!(fill(&mut holed, &views, 9.0, 0.2), 1);
        assert_eq!(holed.open_edges(), 0);
        assert!((holed.volume() / ball.volume() - 1.0).abs() < 0.01 && holed.volume() > 0.0);
    }
}
