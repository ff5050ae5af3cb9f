//! `render`: draws pictures, contact sheets and films of scenes, caches and grooms.

use std::path::PathBuf;

use anyhow::bail;
use forelock::{Assets, GpuPainter, Scene, Studio, write_picture};
use forelock_io::Cache;

use crate::arguments::{BenchBackend, RenderArgs};
use crate::progress::Reporter;
use crate::terminal;

/// Draws the input.
pub fn render(arguments: &RenderArgs) -> anyhow::Result<()> {
    let input = arguments.input.as_path();
    let mut reporter = Reporter::new(false);
    let is_scene = input.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
    let mut cache = None;
    let (scene, assets) = if is_scene {
        let scene = Scene::load(input, &super::overrides(&arguments.sets)?)?;
        let assets = Assets::load(&scene, &mut |progress| reporter.report(progress))?;
        (scene, assets)
    } else {
        let scene = Scene::beside(input, &super::overrides(&arguments.sets)?)?;
        let assets = match Cache::open(input) {
            Ok(opened) => Assets::of_cache(&scene, cache.insert(opened))?,
            Err(_) => Assets::around(&scene, forelock_io::read_groom(input, &scene.groom.import())?.groom)?,
        };
        (scene, assets)
    };
    let painter = match arguments.backend {
        None => GpuPainter::of(&scene)?,
        Some(BenchBackend::Cpu) => None,
        Some(BenchBackend::Gpu) => Some(GpuPainter::open()?),
    };
    let studio = Studio::new(&scene, &assets).drawn_by(painter.as_ref());
    let out = arguments.out.clone().unwrap_or_else(|| default_name(arguments));
    match &mut cache {
        Some(_)
            if arguments.film
                && out.extension().is_some_and(|ending| !ending.eq_ignore_ascii_case("png")) =>
        {
            bail!("{}: a film is an animated PNG, a .png file", out.display());
        }
        Some(cache) if arguments.film => {
            let film = studio.film(cache, &mut |progress| reporter.report(progress))?;
            forelock_io::atomic_write(&out, |file| file.write_all(&film))?;
        }
        Some(cache) if arguments.sheet => write_picture(&out, &studio.sheet(cache)?)?,
        Some(cache) if !arguments.at.is_empty() => write_picture(&out, &studio.strip(cache, &arguments.at)?)?,
        Some(cache) => {
            let frame = arguments.frame.unwrap_or(cache.frames().saturating_sub(1));
            write_picture(&out, &studio.frame(cache, input, frame, 1.0)?)?;
        }
        None if arguments.film || arguments.frame.is_some() || !arguments.at.is_empty() => {
            bail!(
                "{}: a film, a frame or a strip needs a cache: run `forelock simulate` first",
                input.display()
            );
        }
        None if arguments.sheet => write_picture(&out, &studio.sides()?)?,
        None => write_picture(&out, &studio.picture(assets.groom.positions(), 0.0, 1.0)?)?,
    }
    terminal::line(out.display().to_string())
}

fn default_name(arguments: &RenderArgs) -> PathBuf {
    let name = match (arguments.film, arguments.sheet) {
        (true, _) => "film.png",
        (_, true) => "sheet.png",
        _ => "picture.png",
    };
    arguments.input.with_file_name(name)
}
