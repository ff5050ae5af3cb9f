//! Files that were opened last.
//!
//! # Practice
//! A list of one path a line, newest first, in the file `recent` in `forelock` in
//! `$XDG_STATE_HOME`, `~/.local/state` or `%LOCALAPPDATA%`. Where it cannot be read or written,
//! the list lasts as long as the window.

use std::path::{Path, PathBuf};

use eframe::egui;

/// The longest list.
const MOST: usize = 8;

/// Files that were opened last, newest first.
#[derive(Clone, Debug, Default)]
pub struct Recent {
    file: Option<PathBuf>,
    paths: Vec<PathBuf>,
}

impl Recent {
    /// The list of the user.
    pub fn of_user() -> Self {
        state_folder().map_or_else(Self::default, |folder| Self::read(folder.join("recent")))
    }

    /// The list in `file`; none if it cannot be read.
    pub fn read(file: PathBuf) -> Self {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        let paths = text.lines().map(PathBuf::from).filter(|path| path.is_absolute());
        Self { paths: paths.take(MOST).collect(), file: Some(file) }
    }

    /// The paths, newest first.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Makes `path` the newest, and writes the list.
    pub fn add(&mut self, path: &Path) {
        let Ok(path) = std::path::absolute(path) else { return };
        self.paths.retain(|own| *own != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        let Some(file) = &self.file else { return };
        // A path with a line break, or that is no text, is not kept beyond the window.
        let lines = self.paths.iter().filter_map(|path| path.to_str().filter(|own| !own.contains('\n')));
        let text: String = lines.flat_map(|line| [line, "\n"]).collect();
        let folder = file.parent().map_or(Ok(()), std::fs::create_dir_all);
        // Without it the window works as well.
        let _ = folder.map(|()| forelock_io::atomic_write(file, |out| out.write_all(text.as_bytes())));
    }

    /// Draws the menu of the list. Returns the path that was chosen.
    pub fn show(&self, ui: &mut egui::Ui) -> Option<PathBuf> {
        let mut chosen = None;
        ui.add_enabled_ui(!self.paths.is_empty(), |ui| {
            ui.menu_button("Open recent", |ui| {
                for path in &self.paths {
                    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
                    if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
                        chosen = Some(path.clone());
                        ui.close();
                    }
                }
            });
        });
        chosen
    }
}

/// Where programs keep such lists.
fn state_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_STATE_HOME")
        .or_else(|| absolute("HOME").map(|home| home.join(".local/state")))
        .or_else(|| absolute("LOCALAPPDATA"))?;
    Some(base.join("forelock"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_is_first_and_the_list_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state/recent");
        let mut recent = Recent::read(file.clone());
        assert!(recent.paths().is_empty());
        let path = |number: usize| folder.path().join(format!("{number}.toml"));
        (0..12).chain([9]).for_each(|number| recent.add(&path(number)));
        let expected: Vec<_> = [9, 11, 10, 8, 7, 6, 5, 4].map(path).into();
        assert_eq!(recent.paths(), expected);
        assert_eq!(Recent::read(file.clone()).paths(), expected);
        std::fs::write(&file, b"\xff\nnot absolute\n").unwrap();
        assert!(Recent::read(file).paths().is_empty());
    }
}
