//! Meshes and points out of pictures: any run and any cloud of Gaussians, by what it renders.
//!
//! Depth is rendered at the photos' cameras ([`cameras`], [`depth`]), the box that cameras agree on is found, distances to
//! the surface are fused on a sparse grid, the surface is cut where photos saw it, cleaned, smoothed, coloured and thinned
//! out to as many triangles as wanted ([`fuse`]); what that left out is measured ([`coverage`]).
//!
//! Source of the fusion: Curless and Levoy, "A volumetric method for building complex models from range images", 1996.

pub mod cameras;
pub mod coverage;
mod decimate;
pub mod depth;
mod extract;
mod grid;
mod holes;
mod paint;
pub mod points;
mod quadric;
pub mod raster;
mod region;
mod smooth;
mod topology;

use crate::crop::CropBox;
use crate::error::RunError;
use crate::halt::Halt;
use crate::render::Rendered;
use coverage::Coverage;
use depth::{DepthView, Place};
use glam::{DVec3, Vec3};
use losses::metrics::quantise_value;
use render_core::camera::Camera;
use scene_io::export::Mesh;

pub use points::seen_points;

/// Photos that must have seen a sample.
const PHOTOS: u8 = 2;
/// Cells along the longest side, at most and at least, where nothing is said.
const MOST_CELLS: f64 = 1024.0;
const LEAST_CELLS: f64 = 32.0;
/// Blocks at most, 5 KB each; and triangles wanted for each block where no number of blocks is given.
const MOST_BLOCKS: usize = 150_000;
const TRIANGLES_OF_A_BLOCK: usize = 6;
const BLOCKS: [usize; 2] = [4_000, 40_000];
/// How much coarser the grid becomes where it is too large.
const COARSER: f64 = 1.2;
/// Pieces with less than this share of the largest one's triangles are dropped.
const PIECE: f64 = 0.02;
/// Loops up to this share of the box's longest side around are closed.
const LOOP: f64 = 0.25;
/// Rounds of smoothing.
const SMOOTH: usize = 6;

/// Renders what a camera sees.
pub type Draw<'a> = dyn Fn(&Camera) -> Result<Rendered, RunError> + 'a;

/// What is wanted of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// The box; without one, where cameras agree on a surface.
    pub crop: Option<CropBox>,
    /// Cells along the longest side of the box; without a number, as fine as pixels are there.
    pub resolution: Option<usize>,
    /// Triangles at most.
    pub triangles: usize,
}

/// A mesh and how it was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Fused {
    /// With normals and colours; the scene's frame and unit.
    pub mesh: Mesh,
    /// The box that was searched.
    pub crop: CropBox,
    /// Side of a cell, world units.
    pub cell: f64,
    /// Triangles before they were thinned out.
    pub raw: usize,
    /// Triangles of small pieces that were dropped.
    pub dropped: usize,
    /// Holes that were closed.
    pub closed: usize,
    /// How it compares with what the photos' views show.
    pub coverage: Coverage,
}

/// Depth at the cameras of photos and at some between them; see [`cameras::around`]. `go_on` hears of each picture (done, of) and
/// says whether to go on: `None` if not.
///
/// # Errors
/// What `draw` fails with; [`RunError::Option`] without a camera.
///
/// # Panics
/// If a picture of `draw` lacks pixels.
pub fn depth_views(
    draw: &Draw<'_>,
    photos: &[Camera],
    background: [f32; 3],
    go_on: &mut dyn FnMut(usize, usize) -> bool,
) -> Result<Option<Vec<DepthView>>, RunError> {
    let all = cameras::around(photos);
    if all.is_empty() {
        return Err(RunError::Option("there is no camera to render depth from: a mesh needs training views".into()));
    }
    let mut views = Vec::with_capacity(all.len());
    for (i, (camera, place)) in all.iter().enumerate() {
        if !go_on(i, all.len()) {
            return Ok(None);
        }
        views.push(DepthView::new(camera, *place, &draw(camera)?, background));
    }
    if !go_on(all.len(), all.len()) {
        return Ok(None);
    }
    Ok(Some(views))
}

/// The box that most cameras see a surface in; `None` where they see none.
#[must_use]
pub fn seen_box(views: &[DepthView]) -> Option<CropBox> {
    region::Agreed::new(views, None).crop()
}

/// The surface that `views` show; `None` where `halt` is raised on the way.
///
/// # Errors
/// [`RunError::Option`] where no view shows a surface inside the box, and where the grid would be too large.
///
/// # Panics
/// If a side of the box is not a number, or its first corner is beyond the second.
pub fn fuse(views: &[DepthView], options: &MeshOptions, halt: &Halt) -> Result<Option<Fused>, RunError> {
    let agreed = region::Agreed::new(views, options.crop.as_ref());
    let nothing = || {
        RunError::Option(match options.crop {
            Some(_) => "`--box`: the photos' cameras see no opaque surface in it: give a larger one, or none".into(),
            None => "the photos' cameras see no opaque surface: train longer, or use `--method density`".into(),
        })
    };
    let footprint = agreed.footprint().ok_or_else(nothing)?;
    let crop = match options.crop {
        Some(crop) => crop,
        None => agreed.crop().ok_or_else(nothing)?,
    };
    let longest = (DVec3::from(crop[1]) - DVec3::from(crop[0])).max_element();
    let (lattice, blocks) = match options.resolution {
        Some(n) => {
            let lattice = grid::Lattice::new(&crop, longest / n.max(1) as f64);
            let blocks = grid::near_surface(views, &lattice, MOST_BLOCKS).ok_or_else(|| {
                RunError::Option(format!(
                    "`--resolution {n}`: the surface takes more than 800 MB: give a smaller number"
                ))
            })?;
            (lattice, blocks)
        }
        None => fitting(views, &crop, footprint.clamp(longest / MOST_CELLS, longest / LEAST_CELLS), options.triangles),
    };
    let grid = grid::Grid::fuse(views, lattice, &blocks, halt);
    if halt.raised() {
        return Ok(None);
    }
    let photos = views.iter().filter(|v| v.place == Place::Photo).count();
    let mut mesh = extract::extract(&grid, PHOTOS.min(photos.max(1) as u8));
    let (cell, reach) = (lattice.cell, lattice.reach());
    drop(grid);

    topology::part_fans(&mut mesh);
    let dropped = topology::drop_small(&mut mesh, PIECE);
    if halt.raised() {
        return Ok(None);
    }
    let closed = holes::fill(&mut mesh, views, LOOP * longest, 2.0 * reach);
    smooth::smooth(&mut mesh, SMOOTH);
    let raw = mesh.triangles.len();
    if halt.raised() {
        return Ok(None);
    }
    let colours = paint::paint(&mesh, views, reach);
    finish(&mut mesh, &colours, cell, options.triangles, halt);
    if halt.raised() {
        return Ok(None);
    }
    let coverage = Coverage::of(&mesh, views, &crop);
    Ok(Some(Fused { mesh, crop, cell, raw, dropped, closed, coverage }))
}

/// At most `triangles` triangles, with colours and normals. `cell` is the length that errors are measured in.
fn finish(mesh: &mut Mesh, colours: &[Vec3], cell: f64, triangles: usize, halt: &Halt) {
    if mesh.triangles.len() > triangles {
        decimate::decimate(mesh, colours, cell, triangles, halt);
    } else {
        mesh.colours = colours.iter().map(|c| c.to_array().map(quantise_value)).collect();
    }
    mesh.smooth_normals();
}

/// `mesh`, with colours, thinned out to at most `triangles`; to more where `halt` is raised on the way.
///
/// # Panics
/// If a triangle names a vertex that does not exist.
pub fn thin_out(mesh: &mut Mesh, triangles: usize, halt: &Halt) {
    let colours: Vec<Vec3> = mesh.colours.iter().map(|c| Vec3::from(c.map(|x| f32::from(x) / 255.0))).collect();
    let edges = (mesh.triangles.len() * 3).max(1) as f64;
    let cell = (mesh.area() / edges).sqrt();
    if mesh.triangles.len() > triangles && cell > 0.0 {
        decimate::decimate(mesh, &colours, cell, triangles, halt);
        mesh.smooth_normals();
    }
}

/// As fine as wanted, unless that takes more blocks than the triangles are worth.
fn fitting(views: &[DepthView], crop: &CropBox, cell: f64, triangles: usize) -> (grid::Lattice, Vec<[usize; 3]>) {
    let most = (triangles / TRIANGLES_OF_A_BLOCK).clamp(BLOCKS[0], BLOCKS[1]);
    let mut cell = cell;
    loop {
        let lattice = grid::Lattice::new(crop, cell);
        // One block always fits.
        match grid::near_surface(views, &lattice, most) {
            Some(blocks) => return (lattice, blocks),
            None => cell *= COARSER,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::Layers;
    use glam::DVec2;

    /// Distance along a ray to a ball around the origin.
    pub(super) fn sphere(radius: f64) -> impl Fn(&render_core::ray::Ray) -> Option<f64> + Sync {
        move |ray| {
            let (b, c) = (ray.o.dot(ray.d), ray.o.length_squared() - radius * radius);
            let root = (b * b - c).sqrt();
            (root.is_finite() && -b - root > 0.0).then_some(-b - root)
        }
    }

    /// An exact picture of something: coloured by place.
    pub(super) fn exact(trace: &(impl Fn(&render_core::ray::Ray) -> Option<f64> + Sync), camera: &Camera) -> Rendered {
        let n = (camera.width * camera.height) as usize;
        let mut layers = Layers::nothing(n, &crate::render::plain_query([0.0; 3], 0.0));
        for i in 0..n {
            let at = DVec2::new((i as u32 % camera.width) as f64 + 0.5, (i as u32 / camera.width) as f64 + 0.5);
            let ray = camera.ray(at).unwrap();
            if let Some(t) = trace(&ray) {
                let colour = if ray.at(t).x > 0.0 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
                (layers.opacity[i], layers.depth[i], layers.median_depth[i], layers.rgb[i]) =
                    (1.0, t as f32, t as f32, colour);
            }
        }
        Rendered { width: camera.width, height: camera.height, layers }
    }

    fn optics(side: u32) -> Camera {
        let f = f64::from(side);
        Camera::pinhole(side, side, f, f, 0.5 * f, 0.5 * f, render_core::camera::Pose::IDENTITY)
    }

    /// The picture of a camera at `eye` that looks at the origin.
    pub(super) fn seen(
        trace: &(impl Fn(&render_core::ray::Ray) -> Option<f64> + Sync),
        eye: DVec3,
        side: u32,
    ) -> DepthView {
        let pose = render_core::camera::Pose::look_at(eye, DVec3::ZERO, eye.any_orthonormal_vector()).unwrap();
        let camera = Camera { pose, ..optics(side) };
        DepthView::new(&camera, Place::Photo, &exact(trace, &camera), [0.0; 3])
    }

    /// Pictures from `n` sides.
    pub(super) fn all_around(
        trace: &(impl Fn(&render_core::ray::Ray) -> Option<f64> + Sync),
        n: usize,
        side: u32,
    ) -> Vec<DepthView> {
        let cameras = cameras::on_a_sphere(&optics(side), DVec3::ZERO, 4.0, n);
        cameras.iter().map(|c| DepthView::new(c, Place::Photo, &exact(trace, c), [0.0; 3])).collect()
    }

    #[test]
    fn a_sphere_seen_from_all_sides_is_closed_and_where_it_is() {
        let views = all_around(&sphere(1.0), 24, 96);
        let fused = fuse(&views, &MeshOptions { crop: None, resolution: None, triangles: 4000 }, &Halt::NEVER)
            .unwrap()
            .unwrap();
        let Fused { mesh, cell, coverage, .. } = &fused;
        assert_eq!(mesh.open_edges(), 0);
        assert!(mesh.triangles.len() <= 4000 && fused.raw > 4000, "{} of {}", mesh.triangles.len(), fused.raw);
        let far: Vec<f64> = mesh.vertices.iter().map(|v| (DVec3::from(*v).length() - 1.0).abs()).collect();
        let mean = far.iter().sum::<f64>() / far.len() as f64;
        assert!(mean < 0.25 * cell, "{mean} of {cell}");
        assert!((mesh.volume() / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.03, "{}", mesh.volume());
        // A pixel at the rim is a large part of so small a picture.
        assert!(coverage.share().unwrap() > 0.96, "{coverage:?}");
        for ((v, n), c) in mesh.vertices.iter().zip(&mesh.normals).zip(&mesh.colours) {
            assert!(glam::Vec3::from(*n).as_dvec3().dot(DVec3::from(*v)) > 0.9);
            if v[0].abs() > 0.1 {
                assert_eq!(c[0] > c[2], v[0] > 0.0, "{v:?} {c:?}");
            }
        }
    }

    #[test]
    fn what_no_camera_saw_stays_open() {
        // All cameras stand above: the underside is not made up.
        let views: Vec<DepthView> = (0..10)
            .map(|k| {
                let turn = f64::from(k) * 0.628;
                seen(&sphere(1.0), DVec3::new(2.0 * turn.cos(), 2.0 * turn.sin(), 3.0), 80)
            })
            .collect();
        let fused = fuse(&views, &MeshOptions { crop: None, resolution: Some(48), triangles: 100_000 }, &Halt::NEVER)
            .unwrap()
            .unwrap();
        assert!(fused.mesh.open_edges() > 0);
        let lowest = fused.mesh.vertices.iter().map(|v| v[2]).fold(9.0, f64::min);
        assert!((-0.35..0.1).contains(&lowest), "{lowest}");
        assert!(fused.coverage.share().unwrap() > 0.93, "{:?}", fused.coverage);
    }

    #[test]
    fn the_box_is_kept_and_an_empty_one_refused() {
        let views = all_around(&sphere(1.0), 12, 48);
        let crop = [[-2.0, -2.0, 0.0], [2.0; 3]];
        let options = MeshOptions { crop: Some(crop), resolution: Some(40), triangles: 100_000 };
        let fused = fuse(&views, &options, &Halt::NEVER).unwrap().unwrap();
        assert!(fused.crop == crop && fused.mesh.vertices.iter().all(|v| v[2] > -0.02));
        let raised = Halt::on(std::sync::Arc::new(true.into()));
        assert_eq!(fuse(&views, &options, &raised).unwrap(), None);
        let empty = MeshOptions { crop: Some([[5.0; 3], [6.0; 3]]), ..options };
        assert!(fuse(&views, &empty, &Halt::NEVER).unwrap_err().to_string().contains("`--box`"));
        assert!(fuse(&[], &MeshOptions { crop: None, ..options }, &Halt::NEVER).is_err());
    }

    #[test]
    fn pictures_are_taken_until_a_stop_is_asked_for() {
        let cameras = cameras::on_a_sphere(&optics(16), DVec3::ZERO, 4.0, 4);
        let trace = sphere(1.0);
        let draw = |camera: &Camera| Ok(exact(&trace, camera));
        let views = depth_views(&draw, &cameras, [0.0; 3], &mut |_, _| true).unwrap().unwrap();
        assert!(views.len() >= 4);
        assert!(depth_views(&draw, &cameras, [0.0; 3], &mut |done, _| done < 2).unwrap().is_none());
        assert!(depth_views(&draw, &[], [0.0; 3], &mut |_, _| true).is_err());
    }
}
