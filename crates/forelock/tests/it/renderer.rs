//! What draws the pictures of a run: `output.renderer`.

use forelock::scene::Override;
use forelock::{Backend, RunOptions, Scene, simulate};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::atomic::AtomicBool;

type AnyError = Box<dyn std::error::Error>;

/// Runs ten frames of the built-in scene into `out` with pictures drawn by `renderer`.
fn run(renderer: &str, out: &Path) -> Result<(), AnyError> {
    let renderer = format!("output.renderer={renderer:?}");
    let size = ["output.width=160", "output.height=120", "output.film=true"];
    let small = ["groom.strands=600", "time.frames=10", "body.sdf_cells=32", &renderer];
    let sets = small.into_iter().chain(size).map(Override::set).collect::<Result<Vec<_>, _>>()?;
    let options = RunOptions { out: out.to_path_buf(), resume: false, backend: Backend::Cpu };
    simulate(&Scene::builtin(&sets)?, &options, &mut |_| {}, &AtomicBool::new(false))?;
    Ok(())
}

/// The first picture of the PNG file at `path`: its width, and its bytes.
fn picture(path: &Path) -> Result<(u32, Vec<u8>), AnyError> {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path)?)).read_info()?;
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("too large")?];
    let info = reader.next_frame(&mut bytes)?;
    bytes.truncate(info.buffer_size());
    Ok((info.width, bytes))
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_gpu_draws_picture_and_film_of_a_run_as_the_cpu_does() -> Result<(), AnyError> {
    let [cpu, gpu] = [tempfile::tempdir()?, tempfile::tempdir()?];
    run("cpu", cpu.path())?;
    run("gpu", gpu.path())?;
    for name in ["picture.png", "film.png"] {
        let [(width, a), (other_width, b)] =
            [picture(&cpu.path().join(name))?, picture(&gpu.path().join(name))?];
        assert_eq!((width, a.len()), (other_width, b.len()), "{name}");
        let sum: u64 = a.iter().zip(&b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = sum as f64 / a.len() as f64;
        let contrast = a.iter().max().zip(a.iter().min()).map_or(0, |(most, least)| most - least);
        println!("{name}: {mean:.3} of 255 apart, contrast {contrast}");
        assert!(mean < 2.0 && contrast > 100, "{name}: {mean} {contrast}");
        // Another rounding somewhere: the GPU has drawn it.
        assert_ne!(a, b, "{name}");
    }
    Ok(())
}

/// Without a GPU such a run ends before its first frame, and its folder is not made.
#[test]
#[cfg_attr(gpu, ignore = "there is a GPU")]
fn without_a_gpu_the_run_does_not_begin() -> Result<(), AnyError> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out");
    let error = run("gpu", &out).err().ok_or("a GPU drew")?.to_string();
    assert!(error.contains("GPU"), "{error}");
    assert!(!out.exists());
    Ok(())
}

#[test]
fn other_renderers_are_refused() -> Result<(), AnyError> {
    let folder = tempfile::tempdir()?;
    let error = run("vulkan", folder.path()).err().ok_or("accepted")?.to_string();
    assert!(error.contains("output.renderer") && error.contains("cpu"), "{error}");
    Ok(())
}
