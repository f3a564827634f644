//! `render`: pictures along a camera path.

use super::film::{Shots, Videographer};
use crate::cli::{Layer, Render};
use crate::session::{Done, Failure, Session};
use crate::show::{Show, line};
use engine::RunError;
use engine::appearance::{AppearancePath, FrameAppearances, PhotoAppearance};
use engine::camera_path::{PathKind, SEEN_FILE, cameras, coverage_csv};
use engine::memory::frames as frame_memory;
use engine::output::{Disk, make_folder, write_file};
use engine::picture::{self, gif_bytes, limited, write_png};
use engine::progress::{Meter, Observer};
use engine::render::{Rendered, plain_query, render};
use engine::run::Run;
use engine::system::{Appearance, Canonical, LayerRequest, Median, Normals, Query};
use engine::time_path::TimePath;
use image::RgbImage;
use render_core::camera::Camera;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use systems::splats::Cloud;

/// Error of a pixel from skipped work where nothing is said: one step of an 8-bit picture.
const PREVIEW_BUDGET: f32 = 1.0 / 255.0;

/// Longest side of the animated preview, pixels: GIF is a large format.
const PREVIEW_SIDE: u32 = 480;

/// Refuses cameras whose pictures the machine has no memory for.
type Fits<'a> = &'a dyn Fn(&[Camera]) -> Result<(), RunError>;

/// What pictures are taken of.
enum Subject<'a, 'b> {
    Run(&'a Run<'b>),
    Cloud(Box<Cloud>),
}

pub(crate) fn run(session: &Session, args: &Render) -> Result<Done, Failure> {
    let mut show = session.show();
    if args.run.is_file() {
        let cloud = super::cloud_file::open(&args.run)?;
        return along(&Subject::Cloud(Box::new(cloud)), args, &mut show);
    }
    let run = session.open(&args.run, &mut show)?;
    along(&Subject::Run(&run), args, &mut show)
}

impl Subject<'_, '_> {
    /// The cameras along a path, and what photos saw of their frames: small pictures tell. `stop` ends that.
    fn shots(
        &self,
        path: Option<&PathKind>,
        frames: Option<usize>,
        time: TimePath,
        stop: &AtomicBool,
        fits: Fits<'_>,
    ) -> Result<Option<Shots>, RunError> {
        match self {
            Self::Run(run) => {
                if let Some(file @ PathKind::File(_)) = path {
                    // Before small pictures of its frames are drawn: a file may hold any size.
                    fits(&cameras(file, &run.scene, &run.train, frames)?)?;
                }
                Ok(run.film(path, frames, time, stop)?.map(Shots::looked_at))
            }
            Self::Cloud(cloud) => {
                let (cameras, line) = cloud.cameras(path.unwrap_or(&PathKind::Orbit), frames)?;
                Ok(Some(Shots::plain(cameras, line)))
            }
        }
    }

    /// The appearance of each frame; `None` where there is one only.
    fn appearance_along(
        &self,
        path: Option<&AppearancePath>,
        camera: Option<&str>,
    ) -> Result<Option<FrameAppearances>, RunError> {
        match (self, path) {
            (Self::Run(run), path) => {
                run.appearance_along(path.unwrap_or(&AppearancePath::Still(PhotoAppearance::Mean)), camera).map(Some)
            }
            (Self::Cloud(_), None) => Ok(None),
            (Self::Cloud(_), Some(_)) => {
                Err(RunError::Option("`--appearance`: a file of Gaussians has one appearance".into()))
            }
        }
    }

    fn moves(&self) -> bool {
        matches!(self, Self::Run(run) if run.train.time_steps() > 1)
    }

    fn query(&self) -> Query {
        match self {
            Self::Run(run) => run.query(),
            Self::Cloud(_) => plain_query([0.0; 3], PREVIEW_BUDGET),
        }
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        match self {
            Self::Run(run) => run.system.bounds(),
            Self::Cloud(cloud) => {
                let (middle, radius) = cloud.extent();
                [(middle - radius).to_array(), (middle + radius).to_array()]
            }
        }
    }

    fn draw(&self, camera: &Camera, query: &Query) -> Result<Rendered, RunError> {
        match self {
            Self::Run(run) => Ok(render(run.system.as_ref(), camera, query)),
            Self::Cloud(cloud) => cloud.render(camera, query),
        }
    }
}

/// What a caller other than the command line wants: the path that fits the scene, in colour and depth.
pub(super) fn animation(run: &Run<'_>, frames: usize, out: &Path, show: &mut Show) -> Result<Done, Failure> {
    let args = Render {
        run: run.folder.clone(),
        path: None,
        appearance: None,
        fit_camera: None,
        time: None,
        frames: Some(frames),
        out: out.into(),
        layers: vec![Layer::Colour, Layer::Depth],
        longest_side: None,
        fps: 15.0,
        error_budget: None,
        video: None,
    };
    along(&Subject::Run(run), &args, show)
}

fn along(subject: &Subject<'_, '_>, args: &Render, show: &mut Show) -> Result<Done, Failure> {
    let interrupt = show.listen()?;
    let one_appearance = matches!(args.appearance, None | Some(AppearancePath::Still(_)));
    let time = args.time.unwrap_or(if subject.moves() { TimePath::WHOLE } else { TimePath::START });
    let frames = match &args.path {
        // The same picture again and again is one picture.
        Some(PathKind::Hold(_)) if one_appearance && time.is_still() => args.frames.or(Some(1)),
        _ => args.frames,
    };
    frame_memory::check_count(frames.unwrap_or(0))?;
    let wants = |layer| args.layers.contains(&layer);
    let normals = if wants(Layer::Normals) { Normals::Compute } else { Normals::Skip };
    let canonical = if wants(Layer::Canonical) { Canonical::Compute } else { Canonical::Skip };
    let layers = LayerRequest { normals, canonical, median: Median::Skip };
    let fits = |cameras: &[Camera]| {
        let drawn: Vec<Camera> = cameras.iter().map(|camera| limited(camera, args.longest_side)).collect();
        frame_memory::check_path(&drawn, layers, PREVIEW_SIDE)
    };
    let mut videographer = Videographer::new(args.video, args.fps)?;
    let appearances = subject.appearance_along(args.appearance.as_ref(), args.fit_camera.as_deref())?;
    let Some(shots) = subject.shots(args.path.as_ref(), frames, time, &interrupt, &fits)? else {
        line("stopped before the first frame");
        return Ok(Done::Interrupted);
    };
    fits(&shots.cameras)?;
    make_folder(&args.out)?;
    if let Some(seen) = &shots.seen {
        write_file(&Disk, &args.out.join(SEEN_FILE), coverage_csv(seen).as_bytes())?;
    }
    shots.lines.iter().for_each(line);
    let cameras = &shots.cameras;
    let bounds = subject.bounds();
    let query = Query { layers, error_budget: args.error_budget.unwrap_or(PREVIEW_BUDGET), ..subject.query() };
    let mut depth_range = None;
    let mut preview: Vec<RgbImage> = Vec::with_capacity(cameras.len());
    let mut meter = Meter::new("frame", cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        if show.stop_asked() {
            break;
        }
        let camera: Camera = limited(camera, args.longest_side);
        let appearance = appearances.as_ref().map_or(Appearance::Mean, |path| path.at(i, cameras.len()));
        let time = time.at(i, cameras.len());
        let query = Query { appearance, time, ..query.clone() };
        let view = subject.draw(&camera, &query)?;
        if show.stop_asked() {
            // It is not whole.
            break;
        }
        // One scale for all frames, from the first, with room on both sides.
        let range = *depth_range.get_or_insert_with(|| {
            let [near, far] = picture::depth_range(&[&view]);
            [near * 0.8, far * 1.25]
        });
        let colour = picture::colour(&view);
        write_layers(args, i, &view, &colour, range, bounds)?;
        let first = first_layer(args, &view, &colour, range, bounds);
        videographer.add(&args.out, &first)?;
        preview.push(small(first));
        meter.advance(show);
    }
    if preview.is_empty() {
        show.finish();
        line(format_args!("stopped before the first of {} frames", cameras.len()));
        return Ok(Done::Interrupted);
    }
    let path = args.out.join("preview.gif");
    write_file(&Disk, &path, &gif_bytes(&preview, args.fps)?)?;
    show.finish();
    let animated = match videographer.finish()? {
        Some((video, encoder)) => format!("{} and, by ffmpeg's {encoder}, {}", path.display(), video.display()),
        None => path.display().to_string(),
    };
    let stopped = preview.len() < cameras.len();
    let of = if stopped { format!(" of {} (stopped)", cameras.len()) } else { String::new() };
    line(format_args!("{} frames{of} in {}, animated: {animated}", preview.len(), args.out.display()));
    say_scales(args, depth_range, bounds);
    Ok(if stopped { Done::Interrupted } else { Done::Finished })
}

/// Write the layers of frame `i` that were asked for.
fn write_layers(
    args: &Render,
    i: usize,
    view: &Rendered,
    colour: &RgbImage,
    range: [f32; 2],
    bounds: [[f64; 3]; 2],
) -> Result<(), RunError> {
    let write = |layer: Layer, name: &str, picture: &dyn Fn() -> RgbImage| match args.layers.contains(&layer) {
        true => write_png(&Disk, &args.out.join(format!("{name}_{i:04}.png")), &picture()),
        false => Ok(()),
    };
    write(Layer::Colour, "colour", &|| colour.clone())?;
    write(Layer::Depth, "depth", &|| picture::depth(view, range))?;
    write(Layer::Opacity, "opacity", &|| picture::opacity(view))?;
    write(Layer::Normals, "normals", &|| picture::normals(view))?;
    write(Layer::Canonical, "canonical", &|| picture::canonical(view, bounds))
}

/// Say what black and white mean in the layers that have a scale.
fn say_scales(args: &Render, depth_range: Option<[f32; 2]>, bounds: [[f64; 3]; 2]) {
    if let (true, Some([near, far])) = (args.layers.contains(&Layer::Depth), depth_range) {
        line(format_args!("depth is drawn from {near:.4} (bright) to {far:.4} (dark), world units along the ray"));
    }
    if args.layers.contains(&Layer::Canonical) {
        let [min, max] = bounds;
        line(format_args!(
            "canonical points are drawn from {:.4} {:.4} {:.4} (black) to {:.4} {:.4} {:.4}, world units: x red, y green, z blue",
            min[0], min[1], min[2], max[0], max[1], max[2]
        ));
    }
}

/// The layer the preview shows: the first one asked for.
fn first_layer(args: &Render, view: &Rendered, colour: &RgbImage, range: [f32; 2], bounds: [[f64; 3]; 2]) -> RgbImage {
    match args.layers.first() {
        Some(Layer::Depth) => picture::depth(view, range),
        Some(Layer::Opacity) => picture::opacity(view),
        Some(Layer::Normals) => picture::normals(view),
        Some(Layer::Canonical) => picture::canonical(view, bounds),
        Some(Layer::Colour) | None => colour.clone(),
    }
}

fn small(picture: RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let longest = width.max(height);
    if longest <= PREVIEW_SIDE {
        return picture;
    }
    let side = |n: u32| (n * PREVIEW_SIDE / longest).max(1);
    image::imageops::resize(&picture, side(width), side(height), image::imageops::FilterType::Triangle)
}
