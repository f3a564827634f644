//! One connected page: its wishes in, pictures out. A thread of its own draws, so that words never wait for pictures.
//!
//! A page that gives no sign of life within a time loses its place: it is asked three times as often, and browsers answer by
//! themselves, also for a tab that is hidden or does nothing. So does a page that takes longer than that to read a message.

use super::desk::{Desk, Job};
use super::header::{Drawer, Quality};
use super::out::{Out, WAITING};
use super::pace::levels;
use super::picture::{self, Painter};
use super::protocol::{Draw, Layer, Message, Save};
use super::save::save;
use super::scene::Scene3d;
use super::seat::Seat;
use super::stage::{Shown, Stage};
use super::turn::large_turn;
use axum::extract::ws::{Message as Frame, WebSocket};
use serde_json::json;
use std::sync::Arc;
use std::time::Duration;
use systems::splats::Cloud;
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, sleep, sleep_until, timeout};

/// Stillness after which better pictures are drawn.
const REST: Duration = Duration::from_millis(120);

/// Between the last word to a client and the end of its connection.
const LINGER: Duration = Duration::from_millis(500);

/// Talk to a page until it leaves, or is silent or reads nothing for `patience`. The seat is free when nobody draws for it any
/// more.
pub(crate) async fn talk(mut socket: WebSocket, stage: Arc<Stage>, patience: Duration, seat: Seat) {
    let (mut shown, mut training, mut fast) = stage.watch();
    let desk = Arc::new(Desk::default());
    let (out, mut drawn) = mpsc::channel(WAITING);
    let (its_desk, its_shown) = (desk.clone(), shown.clone());
    let work = move || {
        let _seat = seat;
        work(&its_desk, &its_shown, &Out(out));
    };
    if let Err(e) = std::thread::Builder::new().name("draw".into()).spawn(work) {
        let _ = timeout(patience, socket.send(error(&format!("no thread to draw with: {e}")))).await;
        return;
    }
    // Said at once, and again whenever it changes.
    shown.mark_changed();
    training.mark_changed();
    fast.mark_changed();
    // What is said of a scene means nothing before the scene; which of several ready branches is taken is random.
    let mut greeted = false;
    let mut ask = tokio::time::interval(patience / 3);
    // A page that was late to read one message is not asked several times at once.
    ask.set_missed_tick_behavior(MissedTickBehavior::Delay);
    // When there was a sign of life; time in which nobody listened does not count.
    let mut heard = Instant::now();
    loop {
        let answer = tokio::select! {
            message = socket.recv() => {
                heard = Instant::now();
                match message {
                    Some(Ok(Frame::Close(_))) | None => break,
                    Some(Ok(frame)) => obey(&frame, &desk),
                    // Too long or broken: nothing that comes after it can be trusted.
                    Some(Err(e)) => {
                        let _ = timeout(patience, socket.send(error(&format!("the message is refused: {e}")))).await;
                        // A connection that is closed before all was read is reset, and what was said last may be lost.
                        sleep(LINGER).await;
                        break;
                    }
                }
            }
            frame = drawn.recv() => match frame {
                Some(frame) => Some(frame),
                // Whoever draws is gone; the page may come again.
                None => break,
            },
            _ = ask.tick() => Some(Frame::Ping(Vec::new().into())),
            () = sleep_until(heard + patience) => break,
            Ok(()) = shown.changed() => {
                greeted = true;
                desk.again();
                Some(Frame::Text(shown.borrow_and_update().text().into()))
            }
            Ok(()) = training.changed(), if greeted => {
                let text = training.borrow_and_update().clone();
                (!text.is_empty()).then(|| Frame::Text(text.as_ref().into()))
            }
            Ok(()) = fast.changed(), if greeted => {
                let text = fast.borrow_and_update().clone();
                (!text.is_empty()).then(|| Frame::Text(text.as_ref().into()))
            }
        };
        if let Some(frame) = answer {
            let since = Instant::now();
            if !matches!(timeout(patience, socket.send(frame)).await, Ok(Ok(()))) {
                break;
            }
            heard += since.elapsed();
        }
    }
    desk.close();
}

/// Put what a page asks on the desk; what is to be said at once.
fn obey(frame: &Frame, desk: &Desk) -> Option<Frame> {
    match frame {
        Frame::Text(text) => match Message::read(text.as_bytes()) {
            Ok(Message::Draw(draw)) => desk.draw(draw),
            Ok(Message::Pick(pick)) => desk.pick(pick),
            Ok(Message::Save(Save { crop })) => desk.save(crop),
            Err(problem) => return Some(error(&problem)),
        },
        Frame::Binary(_) => return Some(error("the message is not understood: it is not text")),
        Frame::Ping(_) | Frame::Pong(_) | Frame::Close(_) => {}
    }
    None
}

fn error(message: &str) -> Frame {
    Frame::Text(error_text(message).into())
}

fn error_text(message: &str) -> String {
    json!({ "type": "error", "message": message }).to_string()
}

/// Do what the desk says until it closes or nobody takes the answers.
fn work(desk: &Desk, shown: &watch::Receiver<Shown>, out: &Out) {
    let mut painter = Painter::default();
    while let Some(job) = desk.next() {
        let scene = shown.borrow().scene().cloned();
        let went = match (job, scene) {
            (Job::Pick(pick), scene) => {
                let point = scene.and_then(|scene| picture::seen_point(scene.as_ref(), &pick));
                out.say(json!({ "type": "picked", "id": pick.id, "point": point }).to_string())
            }
            (Job::Save(crop), scene) => out.say(match save(scene.as_ref(), &crop) {
                Ok(file) => json!({ "type": "saved", "file": file }).to_string(),
                Err(problem) => error_text(&problem),
            }),
            (Job::Draw(number, _), None) => {
                desk.met(number);
                true
            }
            (Job::Draw(number, draw), Some(scene)) => {
                match draw_all(desk, &mut painter, scene.as_ref(), number, &draw, out) {
                    Ok(went) => went,
                    Err(problem) => {
                        desk.met(number);
                        out.say(error_text(&problem))
                    }
                }
            }
        };
        if !went {
            break;
        }
    }
}

/// Pictures of a wish: one in time, and better ones while nothing else is wished for. False when nobody takes them.
fn draw_all(
    desk: &Desk,
    painter: &mut Painter,
    scene: &dyn Scene3d,
    number: u64,
    draw: &Draw,
    out: &Out,
) -> Result<bool, String> {
    if draw.layer.is_of_photo() {
        // A mask is drawn at the size of its photo, whatever that is; the photo itself is only decoded.
        let file = if draw.layer == Layer::Photo {
            picture::photo(scene, draw)?
        } else {
            let Some(turn) = large_turn(Drawer::Scene, &|| desk.is_newest(number)) else { return Ok(true) };
            turn.work(|| picture::photo(scene, draw))?
        };
        desk.met(number);
        return Ok(out.send(file));
    }
    let full = draw.full_size();
    if let Some(cloud) = stand_in(scene, draw) {
        return draw_cloud(desk, painter, scene, cloud.as_ref(), number, draw, out);
    }
    let first = painter.quick_size(draw, Drawer::Scene);
    let quality = |size| match size {
        _ if size == full => Quality::Full,
        _ if size == first => Quality::Quick,
        _ => Quality::Better,
    };
    // Never given up for a newer wish: while the camera moves there always is one.
    let Some(file) = painter.paint(scene, draw, first, Quality::Quick, &|| desk.is_open())? else {
        return Ok(false);
    };
    if !out.send(file) {
        return Ok(false);
    }
    if !desk.rests(number, REST) {
        return Ok(true);
    }
    let mut sizes = levels(first, full);
    if sizes.is_empty() {
        // Large enough, but without what JPEG takes away.
        sizes.push(full);
    }
    for size in sizes {
        let Some(file) = painter.paint(scene, draw, size, quality(size), &|| desk.is_newest(number))? else {
            return Ok(true);
        };
        if !out.send(file) {
            return Ok(false);
        }
    }
    desk.met(number);
    Ok(true)
}

/// The cloud that a wish is drawn from: of what is cropped always, of a field while the camera moves. `None` where the scene draws
/// itself.
fn stand_in(scene: &dyn Scene3d, draw: &Draw) -> Option<Arc<Cloud>> {
    let is_cropped = !draw.crop.keeps_everything();
    // A cloud knows where it is, neither where that was at rest nor where it goes, nor what of it moves.
    let is_of_scene = matches!(draw.layer, Layer::Canonical | Layer::Flow | Layer::Background);
    if (scene.is_quick() && !is_cropped) || is_of_scene {
        return None;
    }
    Some(scene.cloud(&picture::query(scene, draw))?.part(&draw.crop))
}

/// Pictures of a wish by the cloud: one in time, a sharp one, and then the scene itself over it unless it is cropped.
fn draw_cloud(
    desk: &Desk,
    painter: &mut Painter,
    scene: &dyn Scene3d,
    cloud: &Cloud,
    number: u64,
    draw: &Draw,
    out: &Out,
) -> Result<bool, String> {
    let (full, first) = (draw.full_size(), painter.quick_size(draw, Drawer::Cloud));
    let Some(quick) = painter.sketch(scene, cloud, draw, first, Quality::Quick, &|| desk.is_open())? else {
        return Ok(false);
    };
    if !out.send(quick.message) {
        return Ok(false);
    }
    if !desk.rests(number, REST) {
        return Ok(true);
    }
    let is_cropped = !draw.crop.keeps_everything();
    let quality = if is_cropped { Quality::Full } else { Quality::Better };
    let Some(sharp) = painter.sketch(scene, cloud, draw, full, quality, &|| desk.is_newest(number))? else {
        return Ok(true);
    };
    if !out.send(sharp.message) {
        return Ok(false);
    }
    if !is_cropped {
        let best = painter.paint_over(scene, draw, sharp.picture, &|| desk.is_newest(number), out)?;
        match best {
            None => return Ok(true),
            Some(file) => {
                if !out.send(file) {
                    return Ok(false);
                }
            }
        }
    }
    desk.met(number);
    Ok(true)
}
