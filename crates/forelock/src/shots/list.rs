//! Reading a list of shots.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};

use super::{Shot, ShotsError, beside};
use crate::Scene;
use crate::run::folder_name;
use crate::scene::Override;

/// The longest list.
pub(super) const MOST: usize = 100_000;

/// The shots of a list, multiplied out.
#[derive(Clone, Debug)]
pub struct ShotList {
    /// Name of the list: that of its file.
    pub name: String,
    /// The folder of all shots.
    pub out: PathBuf,
    /// The shots, in the order of the list.
    pub shots: Vec<Shot>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawList {
    out: Option<PathBuf>,
    #[serde(default)]
    set: Table,
    #[serde(default)]
    shot: Vec<RawShot>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawShot {
    name: Option<String>,
    scene: Option<PathBuf>,
    #[serde(default)]
    set: Table,
    #[serde(default)]
    vary: Table,
}

/// Dotted keys and their values.
type Keys = BTreeMap<String, Value>;

impl ShotList {
    /// Reads the list at `path`.
    ///
    /// # Errors
    /// [`ShotsError`] if it cannot be read, or a shot cannot be used.
    pub fn load(path: &Path) -> Result<Self, ShotsError> {
        let text =
            fs::read_to_string(path).map_err(|error| ShotsError::Read { path: path.to_owned(), error })?;
        let parse = |message: String| ShotsError::Parse { path: path.to_owned(), message };
        let raw: RawList = toml::from_str(&text).map_err(|error| parse(error.to_string()))?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let out = raw.out.clone().unwrap_or_else(|| Path::new("forelock-out").join(&name));
        let out = beside(path, &out);
        let common = flat(&raw.set);
        let mut shots = Vec::new();
        for (number, own) in (1..).zip(&raw.shot) {
            let begun =
                own.name.clone().or_else(|| Some(own.scene.as_ref()?.file_stem()?.to_str()?.to_owned()));
            let begun = begun.unwrap_or_else(|| "demo".to_owned());
            let varied =
                alternatives(&own.vary).map_err(|message| parse(format!("shot {number}: {message}")))?;
            let count = varied.iter().fold(1_usize, |count, (_, values)| count.saturating_mul(values.len()));
            if shots.len().saturating_add(count) > MOST {
                return Err(ShotsError::Count {
                    path: path.to_owned(),
                    count: shots.len().saturating_add(count),
                });
            }
            for index in 0..count {
                let chosen = choose(&varied, index);
                let name = name_of(&begun, &chosen);
                let mut keys = common.clone();
                keys.extend(flat(&own.set));
                keys.extend(chosen.iter().map(|(key, value)| ((*key).clone(), (*value).clone())));
                let scene = scene(path, own.scene.as_deref(), &keys, &name)
                    .map_err(|error| ShotsError::Scene { number, name: name.clone(), error })?;
                shots.push(Shot { folder: out.join(&name), name, scene });
            }
        }
        if shots.is_empty() {
            return Err(ShotsError::Count { path: path.to_owned(), count: 0 });
        }
        let mut names = HashSet::new();
        // Some file systems do not tell upper from lower case.
        if let Some(shot) = shots.iter().find(|shot| !names.insert(shot.name.to_lowercase())) {
            return Err(ShotsError::Duplicate { path: path.to_owned(), name: shot.name.clone() });
        }
        Ok(Self { name, out, shots })
    }

    /// Keeps the shots named `names` only, in the order of the list; all if there is none.
    ///
    /// # Errors
    /// [`ShotsError::Unknown`] if there is no such shot.
    pub fn only(mut self, names: &[String]) -> Result<Self, ShotsError> {
        if let Some(name) = names.iter().find(|name| self.shots.iter().all(|shot| shot.name != **name)) {
            let known: Vec<&str> = self.shots.iter().map(|shot| &*shot.name).take(20).collect();
            return Err(ShotsError::Unknown { name: name.clone(), known: known.join(", ") });
        }
        self.shots.retain(|shot| names.is_empty() || names.contains(&shot.name));
        Ok(self)
    }
}

/// The scene of a shot of the list at `list`.
fn scene(
    list: &Path,
    file: Option<&Path>,
    keys: &Keys,
    name: &str,
) -> Result<Scene, Box<crate::scene::SceneError>> {
    let one = |(key, value): (&String, &Value)| Override {
        label: format!("`{key}` of the list"),
        key: key.clone(),
        value: value.to_string(),
    };
    let overrides: Vec<Override> = keys.iter().map(one).collect();
    let scene = match file {
        Some(file) => Scene::load(&beside(list, file), &overrides),
        None => Scene::builtin(&overrides),
    };
    let mut scene = scene?.with_absolute_paths();
    name.clone_into(&mut scene.name);
    Ok(scene)
}

/// `table` with its tables in dotted keys.
fn flat(table: &Table) -> Keys {
    let mut keys = Keys::new();
    for (key, value) in table {
        match value {
            Value::Table(inner) => {
                keys.extend(flat(inner).into_iter().map(|(own, value)| (format!("{key}.{own}"), value)));
            }
            value => drop(keys.insert(key.clone(), value.clone())),
        }
    }
    keys
}

/// The alternatives of each key of `vary`.
fn alternatives(vary: &Table) -> Result<Vec<(String, Vec<Value>)>, String> {
    let one = |(key, value)| match value {
        Value::Array(values) if !values.is_empty() => Ok((key, values)),
        _ => Err(format!("vary.\"{key}\" must be a list of values, as in [1, 2, 3]")),
    };
    flat(vary).into_iter().map(one).collect()
}

/// The choice of number `index` of the `varied` keys; the last key changes fastest.
fn choose(varied: &[(String, Vec<Value>)], mut index: usize) -> Vec<(&String, &Value)> {
    let mut chosen = Vec::new();
    for (key, values) in varied.iter().rev() {
        chosen.push((key, &values[index % values.len()]));
        index /= values.len();
    }
    chosen.reverse();
    chosen
}

/// The name of a shot, which suits a folder: `begun`, and what was chosen.
fn name_of(begun: &str, chosen: &[(&String, &Value)]) -> String {
    let mut name = begun.to_owned();
    for (key, value) in chosen {
        let key = key.rsplit('.').next().unwrap_or(key);
        name += &format!("-{key}{}", value.to_string().replace('"', ""));
    }
    folder_name(&name, "shot")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<ShotList, ShotsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.toml");
        fs::write(&path, text).unwrap();
        fs::write(folder.path().join("still.toml"), "body.motion = \"builtin:still\"\n").unwrap();
        ShotList::load(&path)
    }

    #[test]
    fn alternatives_are_multiplied_out() {
        let text = "out = \"all\"\nset.time.frames = 9\n[[shot]]\nscene = \"still.toml\"\n\
                    set.\"solver.kind\" = \"dftl\"\n[[shot]]\nname = \"turn\"\n\
                    vary.\"groom.strands\" = [10, 20, 30]\nvary.solver.kind = [\"ams\", \"xpbd\"]\n";
        let list = load(text).unwrap();
        let names: Vec<&str> = list.shots.iter().map(|shot| &*shot.name).collect();
        assert_eq!(names.len(), 7);
        assert_eq!(names[..3], ["still", "turn-strands10-kindams", "turn-strands10-kindxpbd"]);
        let strands: Vec<_> = list.shots[1..].iter().map(|shot| shot.scene.groom.strands).collect();
        assert_eq!(strands, [10, 10, 20, 20, 30, 30]);
        assert!(
            list.shots.iter().all(|shot| shot.scene.time.frames == 9 && shot.folder.starts_with(&list.out))
        );
        assert_eq!((list.name.as_str(), list.shots[0].scene.solver.kind.name()), ("list", "dftl"));
        let some = list.clone().only(&["still".to_owned()]).unwrap();
        assert_eq!(some.shots.len(), 1);
        assert!(matches!(list.only(&["none".to_owned()]), Err(ShotsError::Unknown { .. })));
    }

    #[test]
    fn what_cannot_be_used_is_told() {
        for (text, words) in [
            ("", "0 shots"),
            ("[[shot]]\nscenes = 1\n", "scenes"),
            ("[[shot]]\nscene = \"missing.toml\"\n", "missing.toml"),
            ("[[shot]]\nset.\"time.frams\" = 3\n", "frams"),
            ("[[shot]]\nvary.\"time.frames\" = 3\n", "list of values"),
            ("[[shot]]\n[[shot]]\n", "two shots"),
            ("[[shot]]\nvary.a = [1, 2, 3]\nvary.b = [1]\nvary.c = []\n", "list of values"),
        ] {
            let error = load(text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_shot_is_done_once_its_summary_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.toml");
        fs::write(&path, "out = \"o\"\n[[shot]]\nset.\"time.frames\" = 2\n").unwrap();
        let shot = ShotList::load(&path).unwrap().shots.remove(0);
        assert_eq!(shot.standing(), super::super::Standing::New);
        shot.prepare(false).unwrap();
        assert_eq!(shot.standing(), super::super::Standing::Begun);
        let summary = |frames: u32| {
            let text = format!(
                "{{\"frames\": {frames}, \"state_hash\": \"a\", \"strands\": 1, \"max_edge_stretch\": 0, \
                 \"max_penetration_m\": 0, \"quarantined_strands\": 0, \"ms_per_frame\": {{\"mean\": 1}}}}"
            );
            fs::write(shot.folder.join("summary.json"), text).unwrap();
        };
        fs::write(shot.folder.join("snapshot.npz"), "").unwrap();
        shot.prepare(true).unwrap();
        assert!(shot.folder.join("snapshot.npz").is_file());
        shot.prepare(false).unwrap();
        assert!(!shot.folder.join("snapshot.npz").is_file());
        summary(1);
        assert_eq!(shot.standing(), super::super::Standing::Begun);
        summary(2);
        assert!(matches!(shot.standing(), super::super::Standing::Done(_)));
        let other = Shot { scene: Scene { gravity: [0.0; 3], ..shot.scene.clone() }, ..shot };
        assert_eq!(other.standing(), super::super::Standing::New);
    }
}
