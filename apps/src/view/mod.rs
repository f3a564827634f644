//! `view`: a page with live pictures of a run or a file, drawn here on the CPU while the camera moves.
//!
//! ```text
//! page  <- JSON, pictures -  session  <- desk ->  picture  ->  Scene3d (a run at a checkpoint)
//!                               ^                                ^
//! server, guard                 stage  <-  follow (newest checkpoint, tail of metrics.csv)
//! ```

mod cloud_scene;
mod connections;
mod cropped;
mod desk;
mod fast;
mod follow;
mod guard;
mod header;
mod out;
mod pace;
mod page;
mod picture;
mod protocol;
mod run_scene;
mod save;
mod scene;
mod seat;
mod server;
mod session;
mod stage;
mod tail;
mod training;
mod turn;
mod wire;

use crate::cli::View;
use crate::interrupt;
use crate::session::{Done, Failure, Session};
use crate::show::line;
use cloud_scene::CloudScene;
use connections::Patience;
use engine::RunError;
use follow::Follower;
use protocol::Message;
use render_core::camera::Camera;
use scene::Scene3d;
use server::Server;
use stage::{Shown, Stage};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// What is said when a signal comes.
const CLOSING: &str = "interrupt heard: closing; again to stop at once";

/// Read a message of the page, and go on with it as the server does: the camera of the picture; `None` where there is none.
///
/// # Errors
/// One line that names what is wrong.
pub(crate) fn camera_of(message: &[u8]) -> Result<Option<Camera>, String> {
    Ok(match Message::read(message)? {
        Message::Draw(draw) => Some(draw.eye.camera(draw.full_size())),
        Message::Pick(pick) => Some(pick.camera()),
        Message::Save(_) => None,
    })
}

/// Serve the page until a signal comes.
pub(crate) fn run(session: &Session, args: &View) -> Result<Done, Failure> {
    let interrupt = interrupt::listen(Box::new(|_| crate::show::note(CLOSING)))?;
    let stage = if args.what.is_dir() {
        if !follow::is_run(&args.what) {
            return Err(refusal(
                &args.what,
                "is not a run folder: there is neither a `config.toml` nor a checkpoint in it",
            ));
        }
        let mut show = session.show();
        let follower = Follower::open(session.app, &args.what, &mut show)?;
        show.finish();
        let stage = follower.stage();
        follower.start()?;
        stage
    } else if args.what.exists() {
        Arc::new(Stage::new(Shown::Scene(Arc::from(open_file(&args.what)?))))
    } else {
        return Err(refusal(&args.what, "is not there: name a run folder (`train SCENE --out DIR` makes one)"));
    };
    let server = Server::bind(&args.host, args.port).map_err(|e| {
        RunError::Option(format!("cannot listen at `--host {}` `--port {}`: {e}", args.host, args.port))
    })?;
    if !server.address.ip().is_loopback() {
        crate::show::note(&format!(
            "warning: `--host {}`: anyone who can reach this machine can view the scene, use its CPU and overwrite the saved crop: there \
             is no password and no encryption; `--host 127.0.0.1` allows this machine only",
            args.host
        ));
    }
    line(format_args!("http://{}/ shows {}; Ctrl-C ends it", server.address, args.what.display()));
    server.run(stage, Patience::new(Duration::from_secs(args.patience)), &interrupt)?;
    Ok(Done::Finished)
}

/// Open a file to look at. Formats of files go here, and nowhere else: whatever implements [`Scene3d`] can be shown.
fn open_file(path: &Path) -> Result<Box<dyn Scene3d>, Failure> {
    let cloud = CloudScene::open(path)?;
    for note in cloud.notes() {
        crate::show::note(note);
    }
    Ok(Box::new(cloud))
}

fn refusal(path: &Path, problem: &str) -> Failure {
    Box::new(RunError::Option(format!("`{}` {problem}", path.display())))
}
