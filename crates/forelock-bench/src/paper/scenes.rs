//! The scenes of `scenes/ams` and `scenes/dftl`, built in, and their assets.

use std::path::Path;
use std::sync::Arc;

use crate::BenchError;
use forelock::Assets;
use forelock::{Observer, Player};
use forelock::{
    Scene,
    scene::{GroomSource, Override},
};
use forelock_core::groom::Groom;

/// A built-in scene file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Builtin {
    /// Name of the file, without its ending.
    pub name: &'static str,
    folder: &'static str,
    text: &'static str,
}

macro_rules! scene {
    ($name:literal) => {
        scene!("scenes/ams/", $name)
    };
    ($folder:literal, $name:literal) => {
        Builtin {
            name: $name,
            folder: $folder,
            text: include_str!(concat!("../../../../", $folder, $name, ".toml")),
        }
    };
}

pub(super) const FIGURE4: Builtin = scene!("figure4");
pub(super) const FIGURE5: Builtin = scene!("figure5");
pub(super) const WIG: Builtin = scene!("wig-wind");
pub(super) const HAND: Builtin = scene!("hand");
pub(super) const HOLLOW_SPHERE: Builtin = scene!("hollow-sphere");
pub(super) const WIND: Builtin = scene!("wind");
pub(super) const ASYMMETRIC: Builtin = scene!("asymmetric");
pub(super) const BEARD: Builtin = scene!("beard");
pub(super) const ROLLER_COASTER: Builtin = scene!("roller-coaster");
pub(super) const GROOMING: Builtin = scene!("grooming");

pub(super) const MANNEQUIN_A: Builtin = scene!("scenes/dftl/", "mannequin-a");
pub(super) const MANNEQUIN_B: Builtin = scene!("scenes/dftl/", "mannequin-b");
pub(super) const HORSE: Builtin = scene!("scenes/dftl/", "running-horse");
pub(super) const BUNNY: Builtin = scene!("scenes/dftl/", "bunny");
pub(super) const DOLL: Builtin = scene!("scenes/dftl/", "doll");

/// The strand of Fig. 4 and the wisp of Fig. 5, OBJ.
pub(super) const HELIX: &[u8] = include_bytes!("../../../../scenes/ams/helix.obj");
pub(super) const WISP: &[u8] = include_bytes!("../../../../scenes/ams/wisp.obj");

/// No keys over a scene.
pub(super) const AS_IT_IS: &[&str] = &[];

impl Builtin {
    /// The scene with `keys` over it and, where its strands are grown, `share` of them. Paths are
    /// relative to its folder under the current one.
    pub fn scene(self, share: f64, keys: &[impl AsRef<str>]) -> Result<Scene, BenchError> {
        let mut overrides =
            keys.iter().map(|key| Override::set(key.as_ref())).collect::<Result<Vec<_>, _>>()?;
        let path = Path::new(self.folder).join(self.name).with_extension("toml");
        let mut scene = Scene::parse(self.text, &path, &overrides)?;
        if share != 1.0 && scene.groom.source == GroomSource::Grow {
            let strands = (f64::from(scene.groom.strands) * share).round().max(1.0);
            overrides.push(Override::set(&format!("groom.strands={strands}"))?);
            scene = Scene::parse(self.text, &path, &overrides)?;
        }
        scene.name = self.name.to_owned();
        Ok(scene)
    }

    /// The same with its assets.
    pub fn load(
        self,
        share: f64,
        keys: &[impl AsRef<str>],
        observer: &mut Observer<'_>,
    ) -> Result<(Scene, Arc<Assets>), BenchError> {
        let scene = self.scene(share, keys)?;
        let assets = Arc::new(Assets::load(&scene, observer)?);
        Ok((scene, assets))
    }
}

/// A player of `scene` with `assets` that only goes forward.
pub(super) fn player(scene: &Scene, assets: &Arc<Assets>) -> Result<Player, BenchError> {
    Ok(Player::builder(scene.clone()).assets(assets.clone()).without_history().build()?)
}

/// The strands in `obj` without a body, as `scene` moves them.
pub(super) fn alone(scene: &Scene, obj: &[u8]) -> Result<Arc<Assets>, BenchError> {
    Ok(Arc::new(Assets::around(scene, strands(scene, obj)?)?))
}

/// The wisp of Fig. 5.
pub(super) fn wisp(scene: &Scene) -> Result<Groom, BenchError> {
    strands(scene, WISP)
}

fn strands(scene: &Scene, obj: &[u8]) -> Result<Groom, BenchError> {
    let groom = forelock_io::obj::read_groom(obj)
        .map_err(|error| forelock_io::ReadError::Format { path: scene.name.clone().into(), error })
        .map_err(forelock::AssetError::from)?;
    Ok(groom)
}
