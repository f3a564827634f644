//! What one page wants drawn: the newest picture counts, older wishes are forgotten.

use super::protocol::{Draw, Pick};
use engine::crop::Crop;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Wishes of one page, between its connection and the thread that draws for it.
#[derive(Default)]
pub(crate) struct Desk {
    wishes: Mutex<Wishes>,
    bell: Condvar,
}

#[derive(Default)]
struct Wishes {
    draw: Option<Draw>,
    /// Counts what would make another picture: wishes, and scenes that changed.
    number: u64,
    /// Number of the wish that was met.
    met: u64,
    pick: Option<Pick>,
    save: Option<Crop>,
    is_closed: bool,
}

/// What is to be done next.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Job {
    /// A picture; the number is that of the wish.
    Draw(u64, Draw),
    /// A point.
    Pick(Pick),
    /// A crop to keep.
    Save(Crop),
}

impl Desk {
    pub(crate) fn draw(&self, draw: Draw) {
        self.change(|w| {
            w.draw = Some(draw);
            w.number += 1;
        });
    }

    pub(crate) fn pick(&self, pick: Pick) {
        self.change(|w| w.pick = Some(pick));
    }

    pub(crate) fn save(&self, crop: Crop) {
        self.change(|w| w.save = Some(crop));
    }

    /// The scene is another one: the last picture is wanted again.
    pub(crate) fn again(&self) {
        self.change(|w| w.number += 1);
    }

    /// Nobody is there any more.
    pub(crate) fn close(&self) {
        self.change(|w| w.is_closed = true);
    }

    /// Wait for something to do; `None` once closed. A picture comes again until it is met.
    pub(crate) fn next(&self) -> Option<Job> {
        let mut wishes = self.lock();
        loop {
            if wishes.is_closed {
                return None;
            }
            if let Some(pick) = wishes.pick.take() {
                return Some(Job::Pick(pick));
            }
            if let Some(crop) = wishes.save.take() {
                return Some(Job::Save(crop));
            }
            if let (true, Some(draw)) = (wishes.number != wishes.met, &wishes.draw) {
                return Some(Job::Draw(wishes.number, draw.clone()));
            }
            wishes = self.bell.wait(wishes).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The wish with this number has its best picture.
    pub(crate) fn met(&self, number: u64) {
        self.lock().met = number;
    }

    pub(crate) fn is_open(&self) -> bool {
        !self.lock().is_closed
    }

    /// Whether nothing came after wish `number`.
    pub(crate) fn is_newest(&self, number: u64) -> bool {
        self.lock().is_newest(number)
    }

    /// Whether nothing comes after wish `number` for a while.
    pub(crate) fn rests(&self, number: u64, a_while: Duration) -> bool {
        let until = Instant::now() + a_while;
        let mut wishes = self.lock();
        while wishes.is_newest(number) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            wishes = self.bell.wait_timeout(wishes, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        false
    }

    fn change(&self, change: impl FnOnce(&mut Wishes)) {
        change(&mut self.lock());
        self.bell.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Wishes> {
        // Wishes are whole between any two statements.
        self.wishes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wishes {
    fn is_newest(&self, number: u64) -> bool {
        !self.is_closed && self.number == number && self.pick.is_none() && self.save.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::super::protocol::Message;
    use super::*;

    fn draw(id: u32) -> Draw {
        let text = format!(
            r#"{{"type": "draw", "id": {id}, "width": 8, "height": 6, "position": [0, 0, 0], "wxyz": [1, 0, 0, 0],
                "fov": 1, "layer": "colour", "limit": 40}}"#
        );
        match Message::read(text.as_bytes()) {
            Ok(Message::Draw(draw)) => draw,
            other => panic!("{other:?}"),
        }
    }

    fn pick() -> Pick {
        Pick { id: 9, eye: draw(1).eye, at: [0.5, 0.5], time: 0.0 }
    }

    #[test]
    fn the_newest_wish_counts() {
        let desk = Desk::default();
        (1..=3).for_each(|id| desk.draw(draw(id)));
        let Some(Job::Draw(number, wish)) = desk.next() else { panic!("there is a wish") };
        assert_eq!(wish.id, 3);
        assert!(desk.is_newest(number));
        desk.draw(draw(4));
        assert!(!desk.is_newest(number) && !desk.rests(number, Duration::from_secs(60)));
        desk.met(number);
        assert!(matches!(desk.next(), Some(Job::Draw(_, wish)) if wish.id == 4));
    }

    #[test]
    fn a_point_comes_first_and_the_picture_again_after_it() {
        let desk = Desk::default();
        desk.draw(draw(1));
        let Some(Job::Draw(number, _)) = desk.next() else { panic!("there is a wish") };
        desk.pick(pick());
        assert!(!desk.is_newest(number));
        assert!(matches!(desk.next(), Some(Job::Pick(_))));
        assert!(matches!(desk.next(), Some(Job::Draw(again, _)) if again == number));
        assert!(desk.rests(number, Duration::from_millis(1)));
    }

    #[test]
    fn of_many_crops_the_newest_is_kept_once() {
        let desk = Desk::default();
        let crop = |faint| Crop { faint, ..Crop::default() };
        (0..100).for_each(|i| desk.save(crop(f64::from(i) / 100.0)));
        assert_eq!(desk.next(), Some(Job::Save(crop(0.99))));
        desk.close();
        assert_eq!(desk.next(), None);
    }

    #[test]
    fn another_scene_wants_the_last_picture_again_and_nothing_where_there_was_none() {
        let desk = Desk::default();
        desk.again();
        desk.draw(draw(1));
        let Some(Job::Draw(number, _)) = desk.next() else { panic!("there is a wish") };
        desk.met(number);
        desk.again();
        assert!(matches!(desk.next(), Some(Job::Draw(n, wish)) if n != number && wish.id == 1));
        desk.close();
        assert!(desk.next().is_none() && !desk.is_open());
    }
}
