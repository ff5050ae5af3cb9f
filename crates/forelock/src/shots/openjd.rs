//! A list of shots as a job of Open Job Description, for render farms.
//!
//! # Theory
//! [Open Job Description](https://github.com/OpenJobDescription/openjd-specifications), the template
//! `jobtemplate-2023-09`: a job has steps, a step runs a command, and may depend on other steps.
//!
//! # Practice
//! Each chunk of frames of a shot is a step that depends on the one before it: it goes on from the
//! snapshot that the one before left in the shot's folder. Workers must reach the list, the scenes
//! and the folder of results under the same paths.

use std::path::Path;

use serde_json::{Value, json};

use super::ShotList;

/// How frames are divided.
#[derive(Clone, Copy, Debug)]
pub struct Chunks {
    /// Frames of a step; 0: all.
    pub frames: u32,
}

/// The template of a job that runs `list`, which is in the file `path`, with the program
/// `forelock`: JSON, which is YAML too.
pub fn openjd(list: &ShotList, path: &Path, chunks: Chunks) -> String {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let path = path.to_string_lossy();
    let mut steps = Vec::new();
    for (number, shot) in (1..).zip(&list.shots) {
        let frames = shot.scene.time.frames;
        let each = if chunks.frames == 0 { frames.max(1) } else { chunks.frames };
        let mut before: Option<String> = None;
        for chunk in 0..frames.div_ceil(each).max(1) {
            let until = frames.min((chunk + 1).saturating_mul(each));
            // A step's name has 64 characters at most.
            let name = format!("{number} to frame {until}");
            let mut step = json!({
                "name": name,
                "script": { "actions": { "onRun": {
                    "command": "{{Param.Forelock}}",
                    "args": ["shots", path, "--only", shot.name, "--until", until.to_string()],
                    "timeout": 7 * 24 * 3600,
                } } },
            });
            if let (Some(before), Value::Object(step)) = (&before, &mut step) {
                step.insert("dependencies".to_owned(), json!([{ "dependsOn": before }]));
            }
            steps.push(step);
            before = Some(name);
        }
    }
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": list.name.chars().take(128).collect::<String>(),
        "parameterDefinitions": [{
            "name": "Forelock",
            "type": "STRING",
            "default": "forelock",
            "description": "The program forelock on the workers.",
        }],
        "steps": steps,
    });
    format!("{template:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_of_a_shot_depend_on_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.toml");
        std::fs::write(&path, "[[shot]]\nvary.\"time.frames\" = [5, 4]\n").unwrap();
        let list = ShotList::load(&path).unwrap();
        let job: Value = serde_json::from_str(&openjd(&list, &path, Chunks { frames: 2 })).unwrap();
        let steps = job["steps"].as_array().unwrap();
        let names: Vec<&str> = steps.iter().map(|step| step["name"].as_str().unwrap()).collect();
        let expected = ["1 to frame 2", "1 to frame 4", "1 to frame 5", "2 to frame 2", "2 to frame 4"];
        assert_eq!(names, expected);
        let depends: Vec<Option<&str>> =
            steps.iter().map(|step| step["dependencies"][0]["dependsOn"].as_str()).collect();
        assert_eq!(depends, [None, Some(expected[0]), Some(expected[1]), None, Some(expected[3])]);
        let whole: Value = serde_json::from_str(&openjd(&list, &path, Chunks { frames: 0 })).unwrap();
        assert_eq!(whole["steps"].as_array().unwrap().len(), 2);
    }
}
