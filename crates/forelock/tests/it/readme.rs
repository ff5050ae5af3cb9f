//! What the README and the pages in `docs` show is what the program does.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use forelock::scene::Override;
use forelock::shots::ShotList;
use forelock::training::TrainingConfig;
use forelock::{Backend, RunOptions, Scene, simulate};

const README: &str = include_str!("../../../../README.md");
const RUNS: &str = include_str!("../../../../docs/runs.md");

/// All blocks of `page` in `language`.
fn blocks<'a>(page: &'a str, language: &str) -> Vec<&'a str> {
    let fence = format!("```{language}\n");
    let starts = page.match_indices(&fence).map(|(at, fence)| at + fence.len());
    starts.filter_map(|at| page[at..].split_once("```").map(|(block, _)| block)).collect()
}

/// The first block of `page` in `language`.
fn block<'a>(page: &'a str, language: &str) -> &'a str {
    blocks(page, language).first().copied().unwrap_or_default()
}

/// Every Markdown page of the repository's root and of `docs`.
fn pages() -> std::io::Result<Vec<(PathBuf, String)>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut pages = Vec::new();
    for folder in ["", "docs", "docs/dev"] {
        for entry in std::fs::read_dir(root.join(folder))? {
            let path = entry?.path();
            if path.extension().is_some_and(|ending| ending == "md") {
                pages.push((path.clone(), std::fs::read_to_string(&path)?));
            }
        }
    }
    Ok(pages)
}

#[test]
fn every_scene_of_the_pages_is_read() -> Result<(), Box<dyn std::error::Error>> {
    let mut read = 0;
    for (path, page) in pages()? {
        for scene in blocks(&page, "toml") {
            let name = Path::new("file.toml");
            let read_as = if path.ends_with("training.md") {
                TrainingConfig::parse(scene, name, &[]).map(drop).map_err(|error| error.to_string())
            } else if path.ends_with("shots.md") {
                let folder = tempfile::tempdir()?;
                std::fs::write(folder.path().join("walk.toml"), "")?;
                std::fs::write(folder.path().join("shots.toml"), scene)?;
                let list = ShotList::load(&folder.path().join("shots.toml"));
                list.map(|list| assert_eq!(list.shots.len(), 7)).map_err(|error| error.to_string())
            } else {
                Scene::parse(scene, name, &[]).map(drop).map_err(|error| error.to_string())
            };
            read_as.map_err(|error| format!("{}: {error}", path.display()))?;
            read += 1;
        }
    }
    assert!(read >= 5, "only {read} scenes were found");
    Ok(())
}

#[test]
fn every_link_between_pages_leads_to_a_file() -> Result<(), Box<dyn std::error::Error>> {
    let mut followed = 0;
    for (path, page) in pages()? {
        for (_, rest) in page.match_indices("](").map(|(at, _)| page.split_at(at + 2)) {
            let link = rest.split(')').next().unwrap_or_default();
            let file = link.split('#').next().unwrap_or_default();
            if file.is_empty() || file.contains("://") || file.contains(char::is_whitespace) {
                continue;
            }
            let folder = path.parent().unwrap_or(Path::new(""));
            assert!(folder.join(file).exists(), "{}: {link} leads nowhere", path.display());
            followed += 1;
        }
    }
    assert!(followed > 40, "only {followed} links were found");
    Ok(())
}

#[test]
fn the_scene_is_the_file() {
    assert_eq!(block(README, "toml"), include_str!("../../../../scenes/bob-and-ball.toml"));
}

#[test]
fn the_summary_has_these_fields() -> Result<(), Box<dyn std::error::Error>> {
    let small = ["groom.strands=20", "time.frames=11", "body.sdf_cells=24", "output.picture=false"];
    let none = ["output.film=false", "output.contact_sheet=false", "output.report=false"];
    let sets: Result<Vec<_>, _> = small.iter().chain(&none).map(|set| Override::set(set)).collect();
    let folder = tempfile::tempdir()?;
    let options = RunOptions { out: folder.path().to_path_buf(), resume: false, backend: Backend::Cpu };
    let summary = simulate(&Scene::builtin(&sets?)?, &options, &mut |_| {}, &AtomicBool::new(false))?;
    let is: serde_json::Value = serde_json::to_value(&summary)?;
    let shown: serde_json::Value = serde_json::from_str(block(RUNS, "json"))?;
    let keys = |value: &serde_json::Value| -> Vec<String> {
        value.as_object().into_iter().flatten().map(|(key, _)| key.clone()).collect()
    };
    assert_eq!(keys(&shown), keys(&is));
    for key in ["ms_per_frame", "solver_ms_per_frame", "ms_per_stage"] {
        assert_eq!(keys(&shown[key]), keys(&is[key]), "{key}");
    }
    Ok(())
}
