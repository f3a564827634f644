//! Whether a run is whole: every file that it promises is there, and something says that all of them were made.

use super::Run;
use super::keeper::first_files;
use super::kept::PICTURES;
use crate::checkpoint;
use crate::error::RunError;
use crate::eval::{Evaluation, Measured, masks};
use crate::folder::{
    APPEARANCE, CONFIG, EVAL, EVAL_CSV, FINISHED, HELD_OUT, MASKS, METRICS, REPORT, SUMMARY, VALIDATION,
};
use crate::output::{read_json, write_file};
use crate::report::AppearanceRow;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
struct Finished {
    step: u64,
}

impl Run<'_> {
    /// Write those of a run's first files that are not there any more: nothing else makes them again.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub(super) fn write_lost(&self) -> Result<(), RunError> {
        for (name, text) in first_files(&self.config, &self.scene, &self.held_out)? {
            let path = self.folder.join(name);
            if !path.is_file() {
                write_file(self.parts.storage, &path, text.as_bytes())?;
            }
        }
        Ok(())
    }

    /// Whether all that follows the training was done at this step.
    pub(super) fn is_marked(&self) -> bool {
        let said = read_json::<Finished>(&self.folder.join(FINISHED)).ok().flatten();
        said.is_some_and(|said| said.step == self.step)
    }

    /// Say that all is done, once every promised file is there.
    ///
    /// # Errors
    /// [`RunError::Missing`] naming what is not there, [`RunError::Write`].
    pub(super) fn mark(&self) -> Result<(), RunError> {
        let missing = self.missing();
        if !missing.is_empty() {
            return Err(RunError::Missing { folder: self.folder.clone(), files: missing });
        }
        let text = serde_json::to_vec(&Finished { step: self.step }).expect("a plain struct serialises");
        write_file(self.parts.storage, &self.folder.join(FINISHED), &text)?;
        super::kept::forget(&self.folder);
        Ok(())
    }

    /// Names of files that a finished run has and this one has not.
    pub(super) fn missing(&self) -> Vec<String> {
        let newest = format!("checkpoint/step-{:08}", self.step);
        let mut names: Vec<String> = [CONFIG, HELD_OUT, METRICS, SUMMARY, REPORT].map(String::from).into();
        if Measured::of(&self.held_out) == Measured::Validation {
            names.push(VALIDATION.into());
        }
        // A run that was to do nothing has nothing to go on from.
        if self.step > 0 || checkpoint::newest_step(&self.folder).is_some() {
            names.extend(["json", "safetensors"].map(|ending| format!("{newest}.{ending}")));
        }
        if !self.held_out.is_empty() {
            names.extend([EVAL, EVAL_CSV].map(String::from));
            let evaluation = read_json::<Evaluation>(&self.folder.join(EVAL)).ok().flatten();
            let stems = evaluation.into_iter().flat_map(|e| e.views).filter_map(|view| view.files);
            names.extend(stems.flat_map(|stem| PICTURES.map(|ending| format!("renders/{stem}{ending}.png"))));
        }
        if let Ok(Some(row)) = AppearanceRow::read(&self.folder) {
            names.extend(row.pictures.iter().map(|(_, file)| format!("{}/{file}", APPEARANCE)));
        }
        if self.folder.join(MASKS).is_dir() {
            names.push(format!("{}/{}", MASKS, masks::FILE));
        }
        names.retain(|name| !self.folder.join(name).is_file());
        names
    }
}
