//! `export`: points, meshes, Gaussians and cameras, in the input's frame and scale.

use super::{Done, Failure, Session};
use crate::cli::Export;
use crate::interrupt;
use crate::show::{Show, line};
use scene_io::export::{write_colmap, write_mesh, write_points, write_transforms};
use scene_io::{SplatOptions, write_splats};
use std::path::Path;
use std::sync::atomic::Ordering;
use systems::RunError;
use systems::crop::Crop;
use systems::data::View;
use systems::frame_points::frame_points;
use systems::output::make_folder;
use systems::progress::{Event, Observer};
use systems::run::Run;
use systems::surface::{centres, default_level, mesh, points};
use systems::system::{Query, Splats};

pub(crate) fn run(session: &Session, args: &Export) -> Result<Done, Failure> {
    let mut show = session.show();
    let run = session.open(&args.run, &mut show)?;
    let crop = crop_of(args)?;
    if !crop.keeps_everything() && args.crop.is_empty() {
        line(format_args!("cropped by `{}`; `--no-crop` exports everything", Crop::path_of(&args.run).display()));
    }
    let bounds = match args.crop.is_empty() {
        true => crop.clip(run.system.bounds()).map_err(RunError::Option)?,
        false => crop.bounds.unwrap_or_else(|| run.system.bounds()),
    };
    if args.points.is_some() || args.mesh.is_some() {
        let [[x0, y0, z0], [x1, y1, z1]] = bounds;
        line(format_args!("box: ({x0:.4}, {y0:.4}, {z0:.4}) to ({x1:.4}, {y1:.4}, {z1:.4}), the input's frame"));
    }
    if let Some(path) = &args.points {
        let query = Query { time: args.time, ..run.query() };
        let cloud = match run.system.splats() {
            Some(splats) => {
                centres(&Splats { gaussians: crop.cloud(&splats.gaussians)?, ..splats }, &bounds, args.count)
            }
            None => points(run.system.as_ref(), &run.train, &query, &bounds, args.count),
        };
        write_points(path, &cloud)?;
        line(format_args!("{} points in {}", cloud.positions.len(), path.display()));
    }
    if let Some(path) = &args.splats {
        let mut cloud = super::baked::splats(&run, args.time, &mut show)?;
        cloud.gaussians = crop.cloud(&cloud.gaussians)?;
        let options = SplatOptions { widening: cloud.rules.widening, ..SplatOptions::default() };
        for note in write_splats(path, &cloud.gaussians, &options)? {
            line(note);
        }
        line(format_args!("{} Gaussians in {}", cloud.gaussians.len(), path.display()));
    }
    if let Some(path) = &args.mesh {
        let level = args.level.map_or_else(|| default_level(&bounds), |level| level as f32);
        let mesh = mesh(run.system.as_ref(), &bounds, level, usize::from(args.resolution), args.time)?;
        write_mesh(path, &mesh)?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        line(format_args!("{triangles} triangles, {vertices} vertices at density {level} in {}", path.display()));
        if triangles == 0 {
            line("the mesh is empty: give a lower `--level`");
        }
    }
    if let Some(folder) = &args.frames {
        return frames(&run, folder, !args.rough, &mut show);
    }
    if let Some(path) = &args.cameras {
        match path.extension().is_some_and(|e| e == "json") {
            true => write_transforms(path, &run.scene.frames)?,
            false => write_colmap(path, &run.scene.frames, &run.scene.points)?,
        }
        line(format_args!("{} cameras in {}", run.scene.frames.len(), path.display()));
    }
    Ok(Done::Finished)
}

/// A file for each photo, in the order of time.
fn frames(run: &Run<'_>, folder: &Path, smooth: bool, show: &mut Show) -> Result<Done, Failure> {
    let interrupt = interrupt::flag()?;
    let mut views: Vec<&View> = run.train.views().iter().chain(run.held_out.views()).filter(|v| v.level == 0).collect();
    views.sort_by(|a, b| a.time.total_cmp(&b.time));
    make_folder(folder)?;
    let mut points = 0;
    for (i, view) in views.iter().enumerate() {
        if interrupt.load(Ordering::Relaxed) {
            line(format_args!("stopped after {i} of {} photos", views.len()));
            return Ok(Done::Interrupted);
        }
        let cloud = frame_points(run.system.as_ref(), view, &run.query(), smooth);
        points += cloud.positions.len();
        write_points(&folder.join(format!("frame_{i:06}.ply")), &cloud)?;
        show.event(Event::View { done: i + 1, of: views.len() });
    }
    show.finish();
    line(format_args!("{points} points of {} photos in {}, in the order of time", views.len(), folder.display()));
    Ok(Done::Finished)
}

/// What is exported: the box of the command line, else what the viewer wrote, else everything.
fn crop_of(args: &Export) -> Result<Crop, RunError> {
    match args.crop.as_slice() {
        [] if args.no_crop => Ok(Crop::default()),
        [] => Ok(Crop::of(&args.run)?.unwrap_or_default()),
        &[x0, y0, z0, x1, y1, z1] if x0 < x1 && y0 < y1 && z0 < z1 => {
            Ok(Crop { bounds: Some([[x0, y0, z0], [x1, y1, z1]]), ..Crop::default() })
        }
        _ => Err(RunError::Option(
            "`--box`: write six numbers x0,y0,z0,x1,y1,z1, each of the first three below its fellow".into(),
        )),
    }
}
