//! What is exported: a run, or a file of Gaussians.

use crate::cli::Export;
use crate::session::{Failure, Session};
use crate::show::Show;
use engine::RunError;
use engine::appearance::AppearancePath;
use engine::camera_path::{PathKind, cameras};
use engine::crop::{Crop, Traits};
use engine::mesh::cameras::on_a_sphere;
use engine::picture::limited;
use engine::render::{Rendered, plain_query, render};
use engine::run::Run;
use engine::system::Query;
use glam::DVec3;
use render_core::camera::Camera;
use render_core::rig::mean_up;
use scene_io::SplatFile;
use systems::splats::Cloud;

/// Cameras around a file of Gaussians, their distance in radii of the scene, and their longest side, pixels.
const AROUND: usize = 72;
const DISTANCE: f64 = 2.2;
const SIDE: u32 = 480;

/// A run, or a file of Gaussians, which has no photos.
pub(super) enum Subject {
    Run(Box<Run<'static>>),
    File { cloud: Box<Cloud>, read: Box<SplatFile> },
}

impl Subject {
    pub(super) fn open(session: &Session, args: &Export, show: &mut Show) -> Result<Self, Failure> {
        if !args.run.is_file() {
            return Ok(Self::Run(Box::new(session.open(&args.run, show)?)));
        }
        let (cloud, read) = (super::super::cloud_file::open(&args.run)?, scene_io::read_splats(&args.run)?);
        Ok(Self::File { cloud: Box::new(cloud), read: Box::new(read) })
    }

    /// The run; the word names what needs one.
    pub(super) fn run(&self, word: &str) -> Result<&Run<'static>, RunError> {
        match self {
            Self::Run(run) => Ok(run),
            Self::File { .. } => {
                Err(RunError::Option(format!("`{word}`: a file of Gaussians has no photos; give a run")))
            }
        }
    }

    /// Whether it is a cloud of Gaussians, with opacity on pictures and no density.
    pub(super) fn is_cloud(&self) -> bool {
        match self {
            Self::Run(run) => run.system.is_cloud(),
            Self::File { .. } => true,
        }
    }

    /// The Gaussians to write: those of a cloud, or a field baked into some; `None` where a stop was asked for meanwhile.
    pub(super) fn gaussians(&self, query: &Query, show: &mut Show) -> Result<Option<SplatFile>, Failure> {
        match self {
            Self::Run(run) => {
                let cloud = super::super::baked::splats(run, query, show)?;
                Ok(cloud.map(|cloud| {
                    let widening = Some(cloud.rules.widening);
                    SplatFile { cloud: cloud.gaussians, widening, notes: Vec::new() }
                }))
            }
            Self::File { read, .. } => Ok(Some(SplatFile::clone(read))),
        }
    }

    /// What a crop leaves of a cloud of Gaussians; `None` where that is everything, and for fields.
    pub(super) fn part(&self, crop: &Crop, query: &Query) -> Result<Option<Cloud>, RunError> {
        if crop.keeps_everything() {
            return Ok(None);
        }
        let splats = match self {
            Self::Run(run) => run.system.splats(query).map(Cloud::exact),
            Self::File { cloud, .. } => Some(cloud.part(|_| true)),
        };
        Ok(splats.map(|cloud| {
            let all = cloud.gaussians();
            let traits = Traits::of(&all);
            cloud.part(|i| crop.keeps(&all, &traits, i))
        }))
    }

    /// From where it is looked at: the file's cameras if one is given, else the photos'; around a file of Gaussians.
    pub(super) fn cameras(&self, args: &Export) -> Result<Vec<Camera>, RunError> {
        let file = args.look_from.as_ref().map(|path| PathKind::File(path.clone()));
        match (self, file) {
            (Self::Run(run), Some(file)) => cameras(&file, &run.scene, &run.train, None),
            (Self::Run(run), None) => Ok(run.train.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect()),
            (Self::File { cloud, .. }, Some(file)) => Ok(cloud.cameras(&file, None)?.0),
            (Self::File { cloud, .. }, None) => {
                let (middle, radius) = cloud.extent();
                Ok(on_a_sphere(&limited(&cloud.camera(0.0), Some(SIDE)), middle, DISTANCE * radius, AROUND))
            }
        }
    }

    /// How it is rendered.
    pub(super) fn query(&self, args: &Export) -> Result<Query, RunError> {
        match (self, &args.appearance) {
            (Self::Run(run), None) => Ok(Query { time: args.time, ..run.query() }),
            (Self::Run(run), Some(word)) => {
                let path = AppearancePath::Still(word.clone());
                let appearance = run.appearance_along(&path, args.fit_camera.as_deref())?.at(0, 1);
                Ok(Query { time: args.time, appearance, ..run.query() })
            }
            (Self::File { .. }, None) => Ok(plain_query([0.0; 3], 0.0)),
            (Self::File { .. }, Some(_)) => {
                Err(RunError::Option("`--appearance`: a file of Gaussians has one appearance".into()))
            }
        }
    }

    pub(super) fn draw(&self, camera: &Camera, query: &Query) -> Result<Rendered, RunError> {
        match self {
            Self::Run(run) => Ok(render(run.system.as_ref(), camera, query)),
            Self::File { cloud, .. } => cloud.render(camera, query),
        }
    }

    /// Which way is up in its frame, about; zero where nothing says.
    pub(super) fn up(&self) -> [f64; 3] {
        match self {
            Self::Run(run) => {
                let poses: Vec<_> = run.train.views().iter().map(|v| v.camera.pose).collect();
                mean_up(&poses).unwrap_or(DVec3::ZERO).to_array()
            }
            Self::File { cloud, .. } => cloud.up().to_array(),
        }
    }
}
