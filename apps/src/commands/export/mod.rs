//! `export`: points, meshes, Gaussians and cameras, in the input's frame and scale.

mod subject;

use crate::cli::{Export, MeshMethod};
use crate::session::{Done, Failure, Session};
use crate::show::{Show, line};
use engine::RunError;
use engine::crop::Crop;
use engine::crop::CropBox;
use engine::data::View;
use engine::mesh::depth::DepthView;
use engine::mesh::{Fused, MeshOptions, depth_views, fuse, seen_points, thin_out};
use engine::output::make_folder;
use engine::progress::{Meter, Observer};
use engine::run::Run;
use engine::surface::frame_points;
use engine::surface::{default_level, mesh, points};
use engine::system::Query;
use scene_io::export::{Mesh, MeshFormat, write_colmap, write_mesh, write_points, write_transforms};
use scene_io::{SplatFile, SplatOptions, write_splats};
use std::path::Path;
use subject::Subject;
use systems::splats::Cloud;

/// Cells of a mesh of density along its longest side.
const DENSITY_CELLS: usize = 256;
/// Triangles of a mesh.
const TRIANGLES: usize = 200_000;
/// No box at all.
const EVERYTHING: CropBox = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
/// Share of the photos' pixels that a mesh should have; below, it is said why it may not.
const GOOD: f64 = 0.9;

/// What one `export` shares.
struct Job<'a> {
    args: &'a Export,
    subject: Subject,
    /// What of it: the box is the only one that counts; without one each export has its own.
    crop: Crop,
    /// How it is rendered.
    query: Query,
    /// What the crop leaves of a cloud of Gaussians, where it leaves anything out.
    part: Option<Cloud>,
    show: Show,
    /// Depth at the photos' cameras, once it was asked for.
    views: Option<Vec<DepthView>>,
}

pub(crate) fn run(session: &Session, args: &Export) -> Result<Done, Failure> {
    let mut show = session.show();
    // Found out before anything is rendered.
    if let Some(path) = &args.mesh {
        MeshFormat::of(path)?;
    }
    if args.appearance.is_some() && (args.method == Some(MeshMethod::Density) || args.level.is_some()) {
        let problem =
            "`--appearance`: a mesh of density has the mean appearance; leave `--method density` and `--level` out";
        return Err(RunError::Option(problem.into()).into());
    }
    let crop = crop_of(args)?;
    let subject = Subject::open(session, args, &mut show)?;
    if !crop.keeps_everything() && args.crop.is_empty() {
        line(format_args!("cropped by `{}`; `--no-crop` exports everything", Crop::path_of(&args.run).display()));
    }
    let query = subject.query(args)?;
    let part = subject.part(&crop, &query)?;
    show.listen()?;
    let mut job = Job { args, subject, query, crop, part, show, views: None };
    let done = match job.all() {
        Ok(()) => Done::Finished,
        Err(Stopped::Interrupted) => Done::Interrupted,
        Err(Stopped::Failed(failure)) => return Err(failure),
    };
    job.show.finish();
    Ok(done)
}

/// Why an export ends early.
enum Stopped {
    Interrupted,
    Failed(Failure),
}

impl<E: Into<Failure>> From<E> for Stopped {
    fn from(error: E) -> Self {
        Self::Failed(error.into())
    }
}

impl Job<'_> {
    fn all(&mut self) -> Result<(), Stopped> {
        if let Some(path) = &self.args.points {
            self.points(path)?;
        }
        if let Some(path) = &self.args.splats {
            self.splats(path)?;
        }
        if let Some(path) = &self.args.mesh {
            self.mesh(path)?;
        }
        if let Some(folder) = &self.args.frames {
            self.frames(folder)?;
        }
        if let Some(path) = &self.args.cameras {
            let scene = &self.subject.run("--cameras")?.scene;
            match path.extension().is_some_and(|e| e == "json") {
                true => write_transforms(path, &scene.frames)?,
                false => write_colmap(path, &scene.frames, &scene.points)?,
            }
            line(format_args!("{} cameras in {}", scene.frames.len(), path.display()));
        }
        Ok(())
    }

    /// Depth at the cameras, rendered once.
    fn look(&mut self) -> Result<(), Stopped> {
        if self.views.is_some() {
            return Ok(());
        }
        let Self { args, subject, query, part, show, .. } = self;
        let part = part.as_ref();
        let draw = |camera: &_| match part {
            Some(cloud) => cloud.render(camera, query),
            None => subject.draw(camera, query),
        };
        let cameras = subject.cameras(args)?;
        let mut meter = Meter::new("picture", cameras.len());
        let mut go_on = |done, _| {
            meter.reach(done, show);
            !show.stop_asked()
        };
        let Some(views) = depth_views(&draw, &cameras, query.background, &mut go_on)? else {
            return Err(self.stopped("nothing more was written"));
        };
        self.show.finish();
        self.views = Some(views);
        Ok(())
    }

    fn points(&mut self, path: &Path) -> Result<(), Stopped> {
        let count = self.args.count;
        let cloud = match &self.subject {
            Subject::Run(run) if !self.subject.is_cloud() => {
                let crop = self.crop.bounds.unwrap_or_else(|| run.system.bounds());
                say_box(&crop);
                let cloud = points(run.system.as_ref(), &run.train, &self.query, &crop, count, &mut self.show);
                if self.show.stop_asked() {
                    return Err(self.stopped(&format!("{} was not written", path.display())));
                }
                cloud
            }
            _ => {
                self.look()?;
                if let Some(crop) = &self.crop.bounds {
                    say_box(crop);
                }
                seen_points(self.views.as_deref().unwrap_or_default(), &self.crop.bounds.unwrap_or(EVERYTHING), count)
            }
        };
        self.show.finish();
        write_points(path, &cloud)?;
        line(format_args!("{} points in {}", cloud.positions.len(), path.display()));
        Ok(())
    }

    /// Says what an interrupted export leaves.
    fn stopped(&mut self, what: &str) -> Stopped {
        self.show.finish();
        line(format_args!("stopped: {what}"));
        Stopped::Interrupted
    }

    fn splats(&mut self, path: &Path) -> Result<(), Stopped> {
        let Some(SplatFile { cloud, widening, .. }) = self.subject.gaussians(&self.query, &mut self.show)? else {
            return Err(self.stopped(&format!("{} was not written", path.display())));
        };
        let cloud = self.crop.cloud(&cloud)?;
        let options = SplatOptions::default().with_widening(widening.unwrap_or_default());
        for note in write_splats(path, &cloud, &options)? {
            line(note);
        }
        line(format_args!("{} Gaussians in {}", cloud.len(), path.display()));
        Ok(())
    }

    fn mesh(&mut self, path: &Path) -> Result<(), Stopped> {
        let (mesh, how) = match self.args.method {
            Some(MeshMethod::Density) => self.dense()?,
            None if self.args.level.is_some() => self.dense()?,
            Some(MeshMethod::Tsdf) | None => self.fused()?,
        };
        write_mesh(path, &mesh, self.subject.up())?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        line(format_args!("{triangles} triangles, {vertices} vertices{how} in {}", path.display()));
        if MeshFormat::of(path)? == MeshFormat::Glb {
            line("its vertices are in the input's frame; the node of the file turns them upright, as glTF has y up");
        }
        Ok(())
    }

    /// The surface that the photos' cameras see.
    fn fused(&mut self) -> Result<(Mesh, String), Stopped> {
        self.look()?;
        if self.show.stop_asked() {
            return Err(self.stopped("the mesh was not written"));
        }
        let options = MeshOptions {
            crop: self.crop.bounds,
            resolution: self.args.resolution.map(usize::from),
            triangles: self.args.triangles.unwrap_or(TRIANGLES),
        };
        let Some(fused) = fuse(self.views.as_deref().unwrap_or_default(), &options, &self.show.halt())? else {
            return Err(self.stopped("the mesh was not written"));
        };
        let Fused { mesh, crop, cell, raw, dropped, closed, coverage } = fused;
        say_box(&crop);
        line(format_args!(
            "cells of {cell:.4}: {raw} triangles, {dropped} of small pieces left out, {closed} holes closed"
        ));
        if let Some(share) = coverage.share() {
            let missed = 100.0 * coverage.missed as f64 / coverage.pixels as f64;
            line(format_args!(
                "of what the photos show there, {:.1} % is within 2 % of the mesh in depth, {missed:.1} % is not on it",
                100.0 * share
            ));
            if share < GOOD {
                line(
                    "where depth differs from photo to photo there is no one surface: train longer, or give a `--box`",
                );
            }
        }
        if mesh.triangles.is_empty() {
            line("the mesh is empty: the cameras do not agree on a surface there");
        }
        Ok((mesh, String::new()))
    }

    /// Where the density of a field crosses a level.
    fn dense(&mut self) -> Result<(Mesh, String), Stopped> {
        let run = self.subject.run("--method density")?;
        let crop = self.crop.bounds.unwrap_or_else(|| run.system.bounds());
        let level = self.args.level.map_or_else(|| default_level(&crop), |level| level as f32);
        let cells = self.args.resolution.map_or(DENSITY_CELLS, usize::from);
        let mut mesh = mesh(run.system.as_ref(), &crop, level, cells, self.args.time, &mut self.show)?;
        if self.show.stop_asked() {
            return Err(self.stopped("the mesh was not written"));
        }
        self.show.finish();
        say_box(&crop);
        if let Some(triangles) = self.args.triangles {
            thin_out(&mut mesh, triangles, &self.show.halt());
            if self.show.stop_asked() {
                return Err(self.stopped("the mesh was not written"));
            }
        }
        if mesh.triangles.is_empty() {
            line("the mesh is empty: give a lower `--level`");
        }
        Ok((mesh, format!(" at density {level}")))
    }

    /// A file for each photo, in the order of time.
    fn frames(&mut self, folder: &Path) -> Result<(), Stopped> {
        let Self { args, subject, query, show, .. } = self;
        let run: &Run<'_> = subject.run("--frames")?;
        let mut views: Vec<&View> =
            run.train.views().iter().chain(run.held_out.views()).filter(|v| v.level == 0).collect();
        views.sort_by(|a, b| a.time.total_cmp(&b.time));
        make_folder(folder)?;
        let mut points = 0;
        let mut meter = Meter::new("photo", views.len());
        for (i, view) in views.iter().enumerate() {
            let cloud = (!show.stop_asked()).then(|| frame_points(run.system.as_ref(), view, query, !args.rough));
            // What a stop came upon is not whole.
            let Some(cloud) = cloud.filter(|_| !show.stop_asked()) else {
                show.finish();
                line(format_args!("stopped after {i} of {} photos, which are in {}", views.len(), folder.display()));
                return Err(Stopped::Interrupted);
            };
            points += cloud.positions.len();
            write_points(&folder.join(format!("frame_{i:06}.ply")), &cloud)?;
            meter.advance(show);
        }
        show.finish();
        line(format_args!("{points} points of {} photos in {}, in the order of time", views.len(), folder.display()));
        Ok(())
    }
}

fn say_box([[x0, y0, z0], [x1, y1, z1]]: &CropBox) {
    line(format_args!("box: ({x0:.4}, {y0:.4}, {z0:.4}) to ({x1:.4}, {y1:.4}, {z1:.4}), the input's frame"));
}

/// What is exported: the box of the command line, else what the viewer wrote, else everything. The one place that says so.
fn crop_of(args: &Export) -> Result<Crop, RunError> {
    match args.crop.as_slice() {
        [] if args.no_crop => Ok(Crop::default()),
        [] => Ok(Crop::of(&args.run)?.unwrap_or_default()),
        &[x0, y0, z0, x1, y1, z1] if x0 < x1 && y0 < y1 && z0 < z1 => {
            Ok(Crop { bounds: Some([[x0, y0, z0], [x1, y1, z1]]), ..Crop::default() })
        }
        _ => Err(RunError::Option(
            "`--box`: write six numbers x0,y0,z0,x1,y1,z1, with x0 < x1, y0 < y1 and z0 < z1".into(),
        )),
    }
}
