//! Uses of resources in a frame and their barrier masks. A check finds conflicting uses without a barrier in between,
//! and barriers that no pair of uses needs.

use ash::vk;
use std::ops::BitOr;

/// One or several ways in which the GPU uses a resource. Barriers are written in these terms.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Use(u32);

#[allow(
    non_upper_case_globals,
    reason = "these are the variants of a set, read as words in `barrier(ColorWrite, ComputeRead)`"
)]
impl Use {
    /// Colour attachment: written, and read by blending or loading.
    pub const ColorWrite: Use = Use(1);
    /// Depth attachment with depth writes.
    pub const DepthWrite: Use = Use(1 << 1);
    /// Depth attachment that is only tested.
    pub const DepthRead: Use = Use(1 << 2);
    /// Read by a vertex shader.
    pub const VertexRead: Use = Use(1 << 3);
    /// Read by a fragment shader.
    pub const FragmentRead: Use = Use(1 << 4);
    /// Written by a fragment shader through a storage descriptor.
    pub const FragmentWrite: Use = Use(1 << 5);
    /// Read by a compute shader.
    pub const ComputeRead: Use = Use(1 << 6);
    /// Written by a compute shader.
    pub const ComputeWrite: Use = Use(1 << 7);
    /// Read as arguments of an indirect call.
    pub const IndirectRead: Use = Use(1 << 8);
    /// Source of a copy.
    pub const CopyRead: Use = Use(1 << 9);
    /// Target of a copy.
    pub const CopyWrite: Use = Use(1 << 10);
    /// Read by the CPU after the work is done.
    pub const HostRead: Use = Use(1 << 11);
    /// Read as vertices of a draw.
    pub const VertexInput: Use = Use(1 << 12);

    const NAMES: [&'static str; 13] = [
        "ColorWrite",
        "DepthWrite",
        "DepthRead",
        "VertexRead",
        "FragmentRead",
        "FragmentWrite",
        "ComputeRead",
        "ComputeWrite",
        "IndirectRead",
        "CopyRead",
        "CopyWrite",
        "HostRead",
        "VertexInput",
    ];

    /// The writing uses of the set.
    fn written(self) -> Use {
        let writing = Use::ColorWrite | Use::DepthWrite | Use::FragmentWrite | Use::ComputeWrite | Use::CopyWrite;
        Use(self.0 & writing.0)
    }

    pub(crate) fn writes(self) -> bool {
        self.written().0 != 0
    }

    fn contains(self, other: Use) -> bool {
        self.0 & other.0 == other.0
    }

    /// Stages and accesses of all uses in the set.
    pub(crate) fn masks(self) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
        type Stage = vk::PipelineStageFlags2;
        type Access = vk::AccessFlags2;
        let shader_read = Access::SHADER_SAMPLED_READ | Access::SHADER_STORAGE_READ | Access::UNIFORM_READ;
        let tests = Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
        let table = [
            (Stage::COLOR_ATTACHMENT_OUTPUT, Access::COLOR_ATTACHMENT_READ | Access::COLOR_ATTACHMENT_WRITE),
            (tests, Access::DEPTH_STENCIL_ATTACHMENT_READ | Access::DEPTH_STENCIL_ATTACHMENT_WRITE),
            (tests, Access::DEPTH_STENCIL_ATTACHMENT_READ),
            (Stage::VERTEX_SHADER, shader_read),
            (Stage::FRAGMENT_SHADER, shader_read),
            (Stage::FRAGMENT_SHADER, Access::SHADER_STORAGE_WRITE),
            (Stage::COMPUTE_SHADER, shader_read),
            (Stage::COMPUTE_SHADER, Access::SHADER_STORAGE_WRITE),
            (Stage::DRAW_INDIRECT, Access::INDIRECT_COMMAND_READ),
            (Stage::COPY, Access::TRANSFER_READ),
            // Updates from the command buffer count as clears.
            (Stage::COPY | Stage::CLEAR, Access::TRANSFER_WRITE),
            (Stage::HOST, Access::HOST_READ),
            (Stage::VERTEX_ATTRIBUTE_INPUT, Access::VERTEX_ATTRIBUTE_READ),
        ];
        let mut masks = (Stage::NONE, Access::NONE);
        for (bit, (stage, access)) in table.into_iter().enumerate() {
            if self.0 & (1 << bit) != 0 {
                masks = (masks.0 | stage, masks.1 | access);
            }
        }
        masks
    }
}

impl BitOr for Use {
    type Output = Use;
    fn bitor(self, other: Use) -> Use {
        Use(self.0 | other.0)
    }
}

impl std::fmt::Display for Use {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let words: Vec<_> = (0..Self::NAMES.len()).filter(|b| self.0 & (1 << b) != 0).map(|b| Self::NAMES[b]).collect();
        f.write_str(&words.join(" | "))
    }
}

impl std::fmt::Debug for Use {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

struct Touch {
    resource: u64,
    zone: &'static str,
    how: Use,
    /// Number of barriers recorded before this use.
    at: usize,
}

struct Barrier {
    from: Use,
    to: Use,
    zone: &'static str,
    needed: bool,
}

/// All uses of resources in a frame, in order. Resources are tracked as a whole. A frame begins with a full barrier, so
/// no conflict reaches across frames.
#[derive(Default)]
pub(crate) struct Log {
    touches: Vec<Touch>,
    barriers: Vec<Barrier>,
    problems: Vec<String>,
}

impl Log {
    pub(crate) fn barrier(&mut self, from: Use, to: Use, zone: &'static str) {
        self.barriers.push(Barrier { from, to, zone, needed: false });
    }

    /// Records a use and checks it against the resource's last write and all reads since.
    pub(crate) fn touch(&mut self, resource: u64, name: &str, how: Use, zone: &'static str) {
        let at = self.barriers.len();
        let mut reads_between = false;
        for touch in self.touches.iter().rev().filter(|t| t.resource == resource) {
            let write = touch.how.writes();
            // A write followed by checked reads is already ordered before anything that is ordered after the reads.
            let conflict = if write { !(how.writes() && reads_between) } else { how.writes() };
            if conflict {
                let between = &mut self.barriers[touch.at..at];
                // For a use that reads and writes, waiting for the writes is enough.
                let from = if write { touch.how.written() } else { touch.how };
                match between.iter_mut().find(|b| b.from.contains(from) && b.to.contains(how)) {
                    Some(barrier) => barrier.needed = true,
                    None => self
                        .problems
                        .push(format!("{name}: no barrier between {}:{} and {zone}:{how}", touch.zone, touch.how)),
                }
            }
            if write {
                break;
            }
            reads_between = true;
        }
        let repeated = self
            .touches
            .iter()
            .rev()
            .take_while(|t| t.at == at)
            .any(|t| t.resource == resource && t.how == how && !how.writes());
        if !repeated {
            self.touches.push(Touch { resource, zone, how, at });
        }
    }

    /// Missing barriers, and barriers that separate nothing.
    pub(crate) fn problems(mut self) -> Vec<String> {
        for (i, barrier) in self.barriers.iter().enumerate().filter(|(_, b)| !b.needed) {
            self.problems.push(format!(
                "barrier {i} ({} -> {}) after {} separates nothing",
                barrier.from, barrier.to, barrier.zone
            ));
        }
        self.problems
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(script: impl FnOnce(&mut Log)) -> Vec<String> {
        let mut log = Log::default();
        script(&mut log);
        log.problems()
    }

    #[test]
    fn write_then_read_needs_a_barrier() {
        let without = problems(|log| {
            log.touch(1, "vals", Use::ComputeWrite, "rsm");
            log.touch(1, "vals", Use::ComputeRead, "gather");
        });
        assert_eq!(without, ["vals: no barrier between rsm:ComputeWrite and gather:ComputeRead"]);
        let with = problems(|log| {
            log.touch(1, "vals", Use::ComputeWrite, "rsm");
            log.barrier(Use::ComputeWrite, Use::ComputeRead, "rsm");
            log.touch(1, "vals", Use::ComputeRead, "gather");
        });
        assert_eq!(with, [] as [String; 0]);
    }

    #[test]
    fn a_barrier_of_the_wrong_kind_does_not_count_and_is_idle() {
        let found = problems(|log| {
            log.touch(1, "vals", Use::ColorWrite, "rsm");
            log.barrier(Use::ComputeWrite, Use::ComputeRead, "rsm");
            log.touch(1, "vals", Use::ComputeRead, "gather");
        });
        assert_eq!(found.len(), 2, "{found:?}");
    }

    #[test]
    fn read_then_write_needs_an_execution_barrier() {
        let found = problems(|log| {
            log.touch(1, "shadow", Use::FragmentRead, "direct");
            log.touch(1, "shadow", Use::DepthWrite, "direct");
        });
        assert_eq!(found, ["shadow: no barrier between direct:FragmentRead and direct:DepthWrite"]);
    }

    #[test]
    fn a_write_after_checked_reads_needs_only_the_barrier_from_the_reads() {
        let found = problems(|log| {
            log.touch(1, "shadow", Use::DepthWrite, "direct");
            log.barrier(Use::DepthWrite, Use::FragmentRead, "direct");
            log.touch(1, "shadow", Use::FragmentRead, "direct");
            log.barrier(Use::FragmentRead, Use::DepthWrite, "direct");
            log.touch(1, "shadow", Use::DepthWrite, "direct");
        });
        assert_eq!(found, [] as [String; 0]);
    }

    #[test]
    fn reads_do_not_conflict() {
        let found = problems(|log| {
            log.touch(1, "vals", Use::FragmentRead, "gather");
            log.touch(1, "vals", Use::ComputeRead, "info");
        });
        assert_eq!(found, [] as [String; 0]);
    }

    #[test]
    fn masks_are_those_of_the_specification() {
        let (stage, access) = (Use::DepthWrite | Use::FragmentRead).masks();
        assert!(
            stage
                .contains(vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS | vk::PipelineStageFlags2::LATE_FRAGMENT_TESTS)
        );
        assert!(stage.contains(vk::PipelineStageFlags2::FRAGMENT_SHADER));
        assert!(
            access.contains(vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE | vk::AccessFlags2::SHADER_SAMPLED_READ)
        );
        assert!(!access.intersects(vk::AccessFlags2::SHADER_STORAGE_WRITE));
    }
}
