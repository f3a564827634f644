//! `render`: pictures along a camera path.

use super::film::{Shots, Videographer};
use super::layers::Scales;
use crate::cli::{Layer, Render};
use crate::session::{Done, Failure, Session};
use crate::show::{Show, line};
use engine::RunError;
use engine::appearance::{AppearancePath, FrameAppearances, PhotoAppearance};
use engine::camera_path::{PathKind, SEEN_FILE, cameras, coverage_csv};
use engine::flow::FlowPath;
use engine::memory::frames as frame_memory;
use engine::output::{Disk, make_folder, write_file};
use engine::picture::{gif_bytes, limited};
use engine::progress::{Meter, Observer};
use engine::render::{Rendered, plain_query, render};
use engine::run::Run;
use engine::system::{Appearance, Behind, Canonical, LayerRequest, Median, Normals, Query, System};
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

    fn system(&self) -> &dyn System {
        match self {
            Self::Run(run) => run.system.as_ref(),
            Self::Cloud(cloud) => cloud.as_ref(),
        }
    }

    /// The flow along these cameras, as they are drawn.
    fn flow(
        &self,
        cameras: &[Camera],
        time: TimePath,
        query: &Query,
        stop: &AtomicBool,
    ) -> Result<FlowPath<'_>, RunError> {
        let plain = Query { layers: LayerRequest::default(), ..query.clone() };
        let draw = |camera: &Camera, time: f64| self.draw(camera, &Query { time, ..plain.clone() });
        FlowPath::new(self.system(), cameras.to_vec(), time, &draw, stop)
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
    // Flow is that of one surface, not of a mean over an edge.
    let median = if wants(Layer::Flow) { Median::Compute } else { Median::Skip };
    let behind = if wants(Layer::Background) { Behind::Compute } else { Behind::Skip };
    let layers = LayerRequest { normals, canonical, median, behind };
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
    let cameras: Vec<Camera> = shots.cameras.iter().map(|camera| limited(camera, args.longest_side)).collect();
    let query = Query { layers, error_budget: args.error_budget.unwrap_or(PREVIEW_BUDGET), ..subject.query() };
    let flow = match wants(Layer::Flow) {
        true => Some(subject.flow(&cameras, time, &query, &interrupt)?),
        false => None,
    };
    make_folder(&args.out)?;
    if let Some(seen) = &shots.seen {
        write_file(&Disk, &args.out.join(SEEN_FILE), coverage_csv(seen).as_bytes())?;
    }
    shots.lines.iter().for_each(line);
    let mut scales = Scales::new(subject.bounds(), flow);
    let mut preview: Vec<RgbImage> = Vec::with_capacity(cameras.len());
    let mut meter = Meter::new("frame", cameras.len());
    let mut drawn = 0;
    for (i, camera) in cameras.iter().enumerate() {
        if show.stop_asked() {
            break;
        }
        let appearance = appearances.as_ref().map_or(Appearance::Mean, |path| path.at(i, cameras.len()));
        let time = time.at(i, cameras.len());
        let query = Query { appearance, time, ..query.clone() };
        let view = subject.draw(camera, &query)?;
        if show.stop_asked() {
            // It is not whole.
            break;
        }
        let frame = scales.frame(i, &view);
        frame.write(args, i)?;
        // Of the last frame there is no flow.
        if let Some(first) = frame.first(args) {
            videographer.add(&args.out, &first)?;
            preview.push(small(first));
        }
        drawn += 1;
        meter.advance(show);
    }
    if drawn == 0 {
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
    let stopped = drawn < cameras.len();
    let of = if stopped { format!(" of {} (stopped)", cameras.len()) } else { String::new() };
    line(format_args!("{drawn} frames{of} in {}, animated: {animated}", args.out.display()));
    scales.say(&args.layers);
    Ok(if stopped { Done::Interrupted } else { Done::Finished })
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
