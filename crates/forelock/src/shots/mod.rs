//! Many shots: a list of scenes, each with overrides and alternatives, as one scene a shot.
//!
//! # Practice
//! [`ShotList::load`] reads a TOML file and multiplies its entries out:
//!
//! ```toml
//! out = "renders"                 # folder of all shots; forelock-out/NAME beside the list
//! set."time.frames" = 120         # laid over every scene
//!
//! [[shot]]
//! name = "walk"
//! scene = "walk.toml"             # without it the scene of `forelock demo`
//! set."solver.kind" = "ams"
//!
//! [[shot]]
//! name = "turn"                   # turn-seed1-kindams, turn-seed1-kinddftl, turn-seed2-kindams …
//! vary."seed" = [1, 2, 3]
//! vary."solver.kind" = ["ams", "dftl"]
//! ```
//!
//! Each shot has a folder of its name, with its scene in `shot.toml`. Where that file holds the
//! same scene, what is there counts: a finished shot is done, one that was cut short can be
//! resumed.

mod list;
mod openjd;

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::Scene;
use crate::html::{escape, page};
use crate::run::{RunError, SNAPSHOT, SUMMARY, check_written};
use crate::scene::SceneError;

pub use list::ShotList;
pub use openjd::{Chunks, openjd};

/// File of a shot's scene, in its folder.
const SHOT: &str = "shot.toml";

/// Why a list of shots cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ShotsError {
    /// The list cannot be read.
    #[error("{}: {error}", path.display())]
    Read {
        /// The list.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
    /// The list is no list of shots.
    #[error("{}: {message}", path.display())]
    Parse {
        /// The list.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// The scene of a shot cannot be used.
    #[error("shot {number} ({name}): {error}")]
    Scene {
        /// Which entry of the list, from 1.
        number: usize,
        /// Name of the shot.
        name: String,
        /// What is wrong.
        error: Box<SceneError>,
    },
    /// Two shots have one name.
    #[error("{}: two shots are named \"{name}\": give one of them another `name`", path.display())]
    Duplicate {
        /// The list.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// There are none, or too many.
    #[error("{}: {count} shots; a list has 1 to {}", path.display(), list::MOST)]
    Count {
        /// The list.
        path: PathBuf,
        /// How many.
        count: usize,
    },
    /// There is no shot of that name.
    #[error("there is no shot \"{name}\"; the list has: {known}")]
    Unknown {
        /// The name.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// A file of a shot cannot be written.
    #[error(transparent)]
    Write(#[from] forelock_io::WriteError),
    /// A run would write what it reads, or a file twice.
    #[error(transparent)]
    Outputs(#[from] Box<RunError>),
    /// A folder cannot be made.
    #[error("{}: {error}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
}

/// One run of a list.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Name, and name of its folder.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// The scene, with absolute paths.
    pub scene: Scene,
}

/// What a run of a shot found.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct ShotResult {
    /// Frames that are simulated.
    pub frames: u32,
    /// Hash of the solver's state at the end.
    pub state_hash: String,
    /// Strands.
    pub strands: usize,
    /// Largest stretch of an edge.
    pub max_edge_stretch: f64,
    /// Deepest particle inside a solid, metres.
    pub max_penetration_m: f64,
    /// Strands that were reset.
    pub quarantined_strands: u64,
    /// Milliseconds a frame.
    ms_per_frame: Mean,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
struct Mean {
    mean: f64,
}

impl ShotResult {
    /// Milliseconds a frame by the clock, mean.
    pub fn ms_per_frame(&self) -> f64 {
        self.ms_per_frame.mean
    }
}

/// What is there of a shot.
#[derive(Clone, Debug, PartialEq)]
pub enum Standing {
    /// Nothing, or a run of another scene.
    New,
    /// A part of its frames.
    Begun,
    /// All frames.
    Done(ShotResult),
}

impl Shot {
    /// What is there of it.
    pub fn standing(&self) -> Standing {
        let is_same = fs::read_to_string(self.scene_file()).is_ok_and(|text| text == self.scene.to_toml());
        if !is_same {
            return Standing::New;
        }
        match self.result() {
            Some(result) if result.frames >= self.scene.time.frames => Standing::Done(result),
            _ => Standing::Begun,
        }
    }

    /// What its last run found, if it ended.
    pub fn result(&self) -> Option<ShotResult> {
        serde_json::from_slice(&fs::read(self.folder.join(SUMMARY)).ok()?).ok()
    }

    /// The file of its scene, which [`Shot::prepare`] writes.
    pub fn scene_file(&self) -> PathBuf {
        self.folder.join(SHOT)
    }

    /// Makes its folder, checks its outputs and writes its scene there. The summary of an earlier
    /// run is removed, so that none is there until the new one ends, and unless it `goes_on` its
    /// snapshot too.
    ///
    /// # Errors
    /// [`ShotsError`] if its run would write what it reads, or that cannot be written.
    pub fn prepare(&self, goes_on: bool) -> Result<(), ShotsError> {
        let folder = |error| ShotsError::Folder { path: self.folder.clone(), error };
        fs::create_dir_all(&self.folder).map_err(folder)?;
        check_written(&self.scene, &self.folder).map_err(Box::new)?;
        let old: &[&str] = if goes_on { &[SUMMARY] } else { &[SUMMARY, SNAPSHOT] };
        for name in old {
            match fs::remove_file(self.folder.join(name)) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(folder(error)),
                _ => {}
            }
        }
        let text = self.scene.to_toml();
        forelock_io::atomic_write(&self.scene_file(), |file| file.write_all(text.as_bytes()))?;
        Ok(())
    }
}

/// A row of the page of results.
#[derive(Clone, Debug)]
pub struct Row<'a> {
    /// The shot.
    pub shot: &'a Shot,
    /// What its run found, or why there is nothing.
    pub outcome: Result<ShotResult, String>,
}

/// The page of results, with links into the folders, which are beside it.
pub fn results_page(name: &str, rows: &[Row<'_>]) -> String {
    let done = rows.iter().filter(|row| row.outcome.is_ok()).count();
    let mut body = format!(
        "<h1>{}</h1><p>{done} of {} shots are done.</p><table><thead><tr><th>shot</th><th>solver</th>\
         <th>strands</th><th>frames</th><th>ms a frame</th><th>stretch</th><th>inside, mm</th>\
         <th>reset</th><th>state</th></tr></thead><tbody>",
        escape(name),
        rows.len()
    );
    for Row { shot, outcome } in rows {
        let name = escape(&shot.name);
        let solver = escape(shot.scene.solver.kind.name());
        let cells = match outcome {
            Ok(own) => format!(
                "<td>{}</td><td>{}</td><td>{:.1}</td><td>{:.1e}</td><td>{:.2}</td><td>{}</td>\
                 <td><code>{}</code></td>",
                own.strands,
                own.frames,
                own.ms_per_frame(),
                own.max_edge_stretch,
                own.max_penetration_m * 1e3,
                own.quarantined_strands,
                escape(&own.state_hash)
            ),
            Err(why) => format!("<td colspan=\"7\">{}</td>", escape(why)),
        };
        body +=
            &format!("<tr><td><a href=\"{name}/report.html\">{name}</a></td><td>{solver}</td>{cells}</tr>");
    }
    body += "</tbody></table>";
    let pictures = rows.iter().filter(|row| row.shot.folder.join("picture.png").is_file());
    for row in pictures {
        let name = escape(&row.shot.name);
        body += &format!(
            "<figure><img src=\"{name}/picture.png\" alt=\"{name}\" width=\"300\"><figcaption>{name}\
             </figcaption></figure>"
        );
    }
    page(name, &body)
}

/// `path` relative to the folder of `file`.
fn beside(file: &Path, path: &Path) -> PathBuf {
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    absolute.parent().map_or_else(|| path.to_owned(), |folder| folder.join(path))
}
