//! `view`: opens the window.

use crate::arguments::ViewArgs;

/// Opens the window with the input.
#[cfg(feature = "view")]
pub fn view(arguments: &ViewArgs) -> anyhow::Result<()> {
    let overrides = super::overrides(&arguments.sets)?;
    let opened = match &arguments.input {
        None => forelock::Scene::builtin(&overrides)?.into(),
        Some(path) => forelock_view::read(path, &overrides).map_err(anyhow::Error::msg)?,
    };
    let screenshot = arguments.screenshot.clone().map(|path| (path, arguments.after));
    let (backend, draw) = (arguments.backend.into(), arguments.draw.into());
    // What was named is first looked at as it is.
    let plays = arguments.input.is_none();
    Ok(forelock_view::run(forelock_view::Options { opened, backend, draw, plays, screenshot })?)
}

/// Says how to get a window.
#[cfg(not(feature = "view"))]
pub fn view(_: &ViewArgs) -> anyhow::Result<()> {
    anyhow::bail!(
        "this program was built without its window: build it with `cargo build --release --features view`. \
         `forelock render` draws pictures without one"
    )
}
