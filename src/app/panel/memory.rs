//! The memory panel: memory of the device by what it holds, and of the process.

use super::{row, rows};
use crate::cli::thousands;
use egui::Ui;
use lightskin::gpu::{Gpu, ResourceInfo};

/// A part of the memory: its name, what it holds, and the beginnings of the names of its resources.
struct Part {
    name: &'static str,
    help: &'static str,
    begins: &'static [&'static str],
}

/// All parts. A resource belongs to the first one that has a beginning of its name.
const PARTS: [Part; 7] = [
    Part {
        name: "Caches",
        help: "Light caches: their places, which ones each surface uses, their light and depth images. Grows with the number \
               of caches, and with shadows per virtual light.",
        begins: &[
            "atlas.",
            "bounce.",
            "cull.",
            "directions.",
            "gather.",
            "inside.dipoles",
            "occlude.",
            "scene.cache_albedos",
            "scene.cell_",
            "scene.instance_caches",
            "scene.model_caches",
            "scene.references",
        ],
    },
    Part {
        name: "Virtual lights",
        help: "Virtual lights, and the reflective shadow map from which they are made. Grows with the number of lights and with \
               the size of their maps.",
        begins: &["inside.", "pyramid.", "rsm."],
    },
    Part {
        name: "Ray structures",
        help: "Bounding volume hierarchies, triangles and textures for rays: short rays, and shadows by rays.",
        begins: &["rays.", "refit."],
    },
    Part {
        name: "Direct light",
        help: "Shadow maps, or lists of the rays to lights. Grows with the number and size of the maps, or with the number of \
               pixels.",
        begins: &["direct."],
    },
    Part {
        name: "Scene",
        help: "Vertices, materials, textures, lights and skies of the scene, and what poses its meshes.",
        begins: &["deform.", "scene."],
    },
    Part {
        name: "Window",
        help: "The image of the window, its panels, and references to compare with.",
        begins: &["window."],
    },
    Part {
        name: "Pictures",
        help: "Images and lists as large as the picture: surfaces, layers, short rays, light, the result. Grows with the number \
               of pixels, with antialiasing and with glass layers.",
        begins: &[""],
    },
];

/// Bytes in each part.
fn sums(resources: &[ResourceInfo]) -> [u64; PARTS.len()] {
    let mut sums = [0; PARTS.len()];
    for resource in resources {
        let is_in = |part: &Part| part.begins.iter().any(|begin| resource.name.starts_with(begin));
        sums[PARTS.iter().position(is_in).unwrap_or(PARTS.len() - 1)] += resource.bytes;
    }
    sums
}

/// Resident memory of the process \[bytes\]; known on Linux only.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(1024 * line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?)
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

pub(super) fn show(ui: &mut Ui, gpu: &Gpu) {
    let counters = gpu.counters();
    rows(ui, "memory", |ui| {
        let mut line = |name: &str, help: &str, value: String| row(ui, name, help, |ui| ui.label(value));
        let help = "Memory that lightskin has reserved on the device, in large blocks. It includes what is free within these \
                    blocks, and dropped objects that frames still use. The driver's own memory is not known.";
        line("Reserved", help, mib(counters.allocated_bytes));
        for (part, bytes) in PARTS.iter().zip(sums(&gpu.resources())) {
            line(&format!("  {}", part.name), part.help, mib(bytes));
        }
        line("Resources", "Number of buffers and images on the device.", thousands(counters.resources));
        let help = "Dropped objects that frames still use. They are destroyed when these frames are done.";
        line("Dropped", help, thousands(counters.buried));
        if let Some(bytes) = resident() {
            let help =
                "Memory of the process that is in RAM. On a software device it includes the memory of the device.";
            line("Process", help, mib(bytes));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightskin::gpu::ResourceKind;

    #[test]
    fn every_resource_is_in_one_part() {
        let named = |(name, bytes): (&str, u64)| ResourceInfo { name: name.into(), kind: ResourceKind::Buffer, bytes };
        let resources = [
            ("scene.references", 1),
            ("gather.proxies", 2),
            ("rsm.vals", 4),
            ("rays.nodes", 8),
            ("direct.shadow", 16),
            ("scene.vertices", 32),
            ("window.canvas", 64),
            ("gbuffer.normal", 128),
            ("inside.entering", 256),
            ("inside.dipoles", 512),
            ("something.new", 1024),
        ];
        let found = sums(&resources.map(named));
        assert_eq!(found, [515, 260, 8, 16, 32, 64, 1152]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn resident_memory_is_that_of_the_process() {
        let before = resident().expect("known on Linux");
        let block = std::hint::black_box(vec![1_u8; 64 << 20]);
        let after = resident().expect("known on Linux");
        assert!(after >= before + (48 << 20), "{before} bytes, then {after} with {} more", block.len());
    }
}
