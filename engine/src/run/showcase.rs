//! What a run for photos from the wild shows of itself: a view in the appearance of several photos, and masks of a few.
//!
//! Systems with one appearance and no masks write nothing here.

use super::Run;
use crate::error::RunError;
use crate::eval::masks::{MaskOptions, MaskTable, PhotosOf, write_masks};
use crate::folder::{APPEARANCE, MASKS, SUMMARY};
use crate::names::stem;
use crate::output::{make_folder, write_file};
use crate::picture::{colour, limited, write_png};
use crate::progress::{Meter, Observer};
use crate::render::render;
use crate::report::{self, AppearanceRow};
use crate::system::{Appearance, Query};
use losses::metrics::EmptyClass;
use std::path::Path;

/// Photos shown.
const SHOWN: usize = 6;
/// Longest side of a picture of the row, pixels.
const SIDE: u32 = 320;

impl Run<'_> {
    /// Static masks of training photos as the system sees them now; see [`write_masks`].
    ///
    /// # Errors
    /// [`RunError::Option`] for systems that take every pixel for static; unreadable photos, unwritable files.
    pub fn write_masks(
        &self,
        folder: &Path,
        options: MaskOptions,
        observer: &mut dyn Observer,
    ) -> Result<MaskTable, RunError> {
        // Another folder than the run's is the caller's own affair.
        let is_own = folder.starts_with(&self.folder);
        let _lock = if is_own { self.write_lock(observer)? } else { None };
        let table = self.make_masks(folder, options, observer)?;
        let table = table.ok_or_else(|| {
            RunError::Option(format!(
                "`{}` finds no masks: it takes every pixel of every photo for static",
                self.system.name()
            ))
        })?;
        if folder == self.folder.join(MASKS) && self.folder.join(SUMMARY).exists() {
            report::write(self.parts.storage, &self.folder)?;
        }
        Ok(table)
    }

    /// Write the appearance row and the first masks, where there are such.
    pub(super) fn write_showcase(&self, observer: &mut dyn Observer) -> Result<(), RunError> {
        self.write_appearance_row(observer)?;
        if observer.stop_asked() {
            return Ok(());
        }
        let photos = self.train.views().iter().filter(|v| v.level == 0).count();
        let options = MaskOptions { every: photos.div_ceil(SHOWN).max(1), empty: EmptyClass::default() };
        let place = self.folder.join(MASKS);
        // Masks of this step, written by `masks`, will do if there are as many; those of an interrupted run are fewer.
        let enough = |table: MaskTable| table.steps == self.step && table.views.len() >= photos.div_ceil(options.every);
        if MaskTable::read(&place)?.is_some_and(enough) {
            return Ok(());
        }
        self.make_masks(&place, options, observer)?;
        Ok(())
    }

    fn make_masks(
        &self,
        folder: &Path,
        options: MaskOptions,
        observer: &mut dyn Observer,
    ) -> Result<Option<MaskTable>, RunError> {
        let views = PhotosOf { scene: &self.scene, data: &self.train };
        write_masks(self.parts.storage, folder, self.system.as_ref(), self.step, views, options, observer)
    }

    fn write_appearance_row(&self, observer: &mut dyn Observer) -> Result<(), RunError> {
        let system = self.system.as_ref();
        if system.appearance_code(&Appearance::Mean).is_none() {
            return Ok(());
        }
        let Some(view) = self.held_out.views().first().or(self.train.views().first()) else { return Ok(()) };
        let folder = self.folder.join(APPEARANCE);
        make_folder(&folder)?;
        let camera = limited(&view.camera, Some(SIDE));
        let photos: Vec<usize> = (0..self.train.len()).filter(|&i| self.train.view(i).level == 0).collect();
        let few = photos.iter().copied().step_by(photos.len().div_ceil(SHOWN).max(1));
        let shown = std::iter::once(("mean".to_string(), Appearance::Mean))
            .chain(few.map(|i| (self.train.view(i).name.clone(), Appearance::View(i))));
        let shown: Vec<(String, Appearance)> = shown.collect();
        let mut meter = Meter::new("picture of the appearance row", shown.len());
        let mut pictures = Vec::new();
        for (k, (name, appearance)) in shown.into_iter().enumerate() {
            if observer.stop_asked() {
                return Ok(());
            }
            let rendered = render(system, &camera, &Query { appearance, time: view.time, ..self.query() });
            if self.halt.raised() {
                return Ok(());
            }
            let picture = colour(&rendered);
            let file = format!("{k:02}_{}.png", stem(&name));
            write_png(self.parts.storage, &folder.join(&file), &picture)?;
            pictures.push((name, file));
            meter.advance(observer);
        }
        let row = AppearanceRow { view: view.name.clone(), pictures };
        let mut text = serde_json::to_string_pretty(&row).expect("a plain struct serialises");
        text.push('\n');
        write_file(self.parts.storage, &folder.join(AppearanceRow::FILE), text.as_bytes())
    }
}
