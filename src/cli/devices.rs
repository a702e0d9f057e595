//! `lightskin devices`: one line per Vulkan device.

use anyhow::Result;

pub(super) fn run() -> Result<()> {
    let devices = lightskin::gpu::devices()?;
    for d in &devices {
        let state = if d.missing.is_empty() { "ok".to_owned() } else { format!("lacks {}", d.missing.join(", ")) };
        say!("{}  {}  ({}, {}, Vulkan {}): {state}", d.index, d.name, d.kind, d.driver, d.api);
    }
    if devices.is_empty() {
        anyhow::bail!("no Vulkan device; install a driver (mesa-vulkan-drivers has one for machines without a GPU)");
    }
    Ok(())
}
