//! Messages of the viewer's page.

use crate::{Try, sound};
use engine::crop::Crop;
use protocol::Message;
use scene_io::Size;

// The files of `apps` themselves: the crate has a server with it, which would be built with every fuzzer.
#[allow(dead_code, unreachable_pub, reason = "the server's side of the protocol is not used here")]
#[path = "../../../apps/src/view/protocol.rs"]
mod protocol;

#[allow(dead_code, unreachable_pub, reason = "as above")]
#[path = "../../../apps/src/view/pace.rs"]
mod pace;

#[allow(dead_code, unreachable_pub, reason = "as above")]
#[path = "../../../apps/src/view/wire.rs"]
mod wire;

pub(crate) fn open() -> Try {
    Box::new(|bytes| {
        match Message::read(bytes) {
            // It goes to the page as JSON, which has no control characters.
            Err(line) => assert!(!line.is_empty() && line.chars().count() <= 300, "{} bytes", line.len()),
            Ok(Message::Draw(draw)) => {
                let full = draw.full_size();
                assert!((1..=4096).contains(&full.width) && (1..=4096).contains(&full.height), "{full}");
                for size in [full, Size::new(1, 1), Size::new(64, 3)] {
                    sound::camera(&draw.eye.camera(size));
                }
                kept(&draw.crop);
            }
            Ok(Message::Pick(pick)) => sound::camera(&pick.camera()),
            Ok(Message::Save(save)) => kept(&save.crop),
        }
    })
}

/// A crop that passed can be written, and read again.
fn kept(crop: &Crop) {
    assert_eq!(crop.check(), Ok(()));
    let text = serde_json::to_string(crop).unwrap_or_else(|error| panic!("a crop is written: {error}"));
    assert_eq!(serde_json::from_str::<Crop>(&text).ok().as_ref(), Some(crop));
}
