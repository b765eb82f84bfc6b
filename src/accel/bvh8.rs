//! The wide hierarchy that rays traverse: nodes of eight boxes and blocks of four triangles, laid out for SIMD, and
//! instances of structures in other spaces.

use super::bounds::Bounds;
use glam::{Affine3A, Vec3};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Arrays that a traversal reads.
pub(super) struct Bvh8 {
    pub(super) nodes: Vec<Node8>,
    /// The first block is empty.
    pub(super) blocks: Vec<Tri4>,
    pub(super) placed: Vec<Placed>,
    /// Where traversal starts, none if there is nothing.
    pub(super) root: Option<Child>,
}

/// An instance of a mesh with a structure of its own.
pub(super) struct Placed {
    /// World space to the mesh's.
    pub(super) to_local: Affine3A,
    pub(super) root: Child,
    /// Index of the scene's instance.
    pub(super) instance: u32,
}

impl Bvh8 {
    /// No arrays at all.
    pub(super) const EMPTY: Self = Self { nodes: Vec::new(), blocks: Vec::new(), placed: Vec::new(), root: None };

    /// Adds arrays whose indices start from zero, and from one for blocks. Returns how far children that point into them
    /// have to be shifted.
    pub(super) fn append(&mut self, nodes: Vec<Node8>, blocks: impl Iterator<Item = Tri4>) -> Shift {
        let shift = Shift { nodes: self.nodes.len(), blocks: self.blocks.len() - 1 };
        self.nodes.extend(nodes.into_iter().map(|n| Node8 { child: n.child.map(|c| c.shifted(shift)), ..n }));
        self.blocks.extend(blocks);
        assert!(self.blocks.len() <= MAX_BLOCKS, "more blocks than indices");
        shift
    }

    /// Boxes that together hold everything.
    pub(super) fn outer_boxes(&self) -> Vec<Bounds> {
        match self.root {
            Some(root) if root.is_inner() => self.nodes[root.index()].boxes(),
            _ => self.blocks.iter().map(Tri4::bounds).collect(),
        }
    }

    /// Memory of the arrays, bytes.
    pub(super) fn size(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.blocks[..]) + size_of_val(&self.placed[..])
    }

    /// Hash of everything stored.
    pub(super) fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        for node in &self.nodes {
            node.planes.as_flattened().iter().for_each(|x| x.to_bits().hash(&mut hasher));
            node.child.iter().for_each(|c| c.0.hash(&mut hasher));
        }
        for block in &self.blocks {
            let corners = block.corners.as_flattened().as_flattened();
            corners.iter().for_each(|x| x.to_bits().hash(&mut hasher));
            block.triangle.hash(&mut hasher);
        }
        self.placed.iter().for_each(|p| (p.instance, p.root.0).hash(&mut hasher));
        hasher.finish()
    }
}

/// How far nodes and blocks have moved up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    nodes: usize,
    blocks: usize,
}

/// Up to eight children: boxes as six rows (min x, y, z, max x, y, z), one lane per child. Unused lanes are never hit.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug)]
pub(super) struct Node8 {
    pub(super) planes: [[f32; 8]; 6],
    pub(super) child: [Child; 8],
}

impl Node8 {
    /// A node without children.
    pub(super) const EMPTY: Self = {
        let (low, high) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
        Self { planes: [low, low, low, high, high, high], child: [Child::EMPTY; 8] }
    };

    /// The node of up to eight children.
    pub(super) fn new(children: &[(Child, Bounds)]) -> Self {
        let mut node = Self::EMPTY;
        for (lane, (child, Bounds { min, max })) in children.iter().enumerate() {
            node.child[lane] = *child;
            for axis in 0..3 {
                node.planes[axis][lane] = min[axis];
                node.planes[axis + 3][lane] = max[axis];
            }
        }
        node
    }

    /// Boxes of the children, and empty ones.
    fn boxes(&self) -> Vec<Bounds> {
        let corner = |row: usize, lane: usize| Vec3::from_array([0, 1, 2].map(|axis| self.planes[row + axis][lane]));
        (0..8).map(|lane| Bounds { min: corner(0, lane).extend(0.0), max: corner(3, lane).extend(0.0) }).collect()
    }
}

/// What a lane of a node leads to, in 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct Child(pub(super) u32);

const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 28;
const INDEX_MASK: u32 = (1 << COUNT_SHIFT) - 1;
/// Value of the count field that marks an instance.
const INSTANCE_COUNT: u32 = 7;
/// Most blocks in one leaf.
pub(super) const MAX_LEAF_BLOCKS: usize = 7;
/// Most blocks, and most instances, in one structure.
pub(super) const MAX_BLOCKS: usize = INDEX_MASK as usize;

impl Child {
    /// What unused lanes lead to: the first block, which holds no triangle. Even a ray that overflows their boxes' tests
    /// ends there.
    pub(super) const EMPTY: Self = Self(LEAF);

    pub(super) fn inner(node: usize) -> Self {
        debug_assert!(node < LEAF as usize);
        Self(node as u32)
    }

    /// `count` blocks from `first`.
    pub(super) fn leaf(first: usize, count: usize) -> Self {
        debug_assert!((1..=MAX_LEAF_BLOCKS).contains(&count) && first <= MAX_BLOCKS);
        Self(LEAF | (count as u32 - 1) << COUNT_SHIFT | first as u32)
    }

    pub(super) fn instance(index: usize) -> Self {
        debug_assert!(index <= MAX_BLOCKS);
        Self(LEAF | INSTANCE_COUNT << COUNT_SHIFT | index as u32)
    }

    #[inline(always)]
    pub(super) fn is_inner(self) -> bool {
        self.0 & LEAF == 0
    }

    #[inline(always)]
    pub(super) fn is_instance(self) -> bool {
        self.0 >> COUNT_SHIFT == (LEAF >> COUNT_SHIFT | INSTANCE_COUNT)
    }

    /// Number of blocks, for a leaf of triangles.
    #[inline(always)]
    pub(super) fn blocks(self) -> usize {
        (self.0 >> COUNT_SHIFT & 7) as usize + 1
    }

    /// First block or instance of a leaf, node of an inner child.
    #[inline(always)]
    pub(super) fn index(self) -> usize {
        if self.is_inner() { self.0 as usize } else { (self.0 & INDEX_MASK) as usize }
    }

    /// The child after its targets have moved.
    pub(super) fn shifted(self, shift: Shift) -> Self {
        if self.is_inner() {
            Self::inner(self.index() + shift.nodes)
        } else if self.is_instance() || self == Self::EMPTY {
            self
        } else {
            Self::leaf(self.index() + shift.blocks, self.blocks())
        }
    }
}

/// Instance and properties of a stored triangle in 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct Tag(u32);

/// Alpha decides at the hit point whether there is a surface.
const MASKED: u32 = 1 << 31;
/// The surface lets part of the light through.
const BLENDED: u32 = 1 << 30;
/// The transform mirrors: the front face winds clockwise.
const FLIPPED: u32 = 1 << 29;
/// Most instances in a scene.
pub(super) const MAX_INSTANCES: usize = FLIPPED as usize;

impl Tag {
    pub(super) fn new(instance: usize, flipped: bool, alpha: AlphaTest) -> Self {
        let alpha = match alpha {
            AlphaTest::None => 0,
            AlphaTest::Mask => MASKED,
            AlphaTest::Blend => BLENDED,
        };
        Self(instance as u32 | if flipped { FLIPPED } else { 0 } | alpha)
    }

    #[inline(always)]
    pub(super) fn instance(self) -> u32 {
        self.0 & (FLIPPED - 1)
    }

    #[inline(always)]
    pub(super) fn flipped(self) -> bool {
        self.0 & FLIPPED != 0
    }

    #[inline(always)]
    pub(super) fn masked(self) -> bool {
        self.0 & MASKED != 0
    }

    #[inline(always)]
    pub(super) fn blended(self) -> bool {
        self.0 & BLENDED != 0
    }
}

/// How a triangle's material lets rays pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AlphaTest {
    /// Not at all.
    None,
    /// Through holes.
    Mask,
    /// In part.
    Blend,
}

/// A triangle as a block stores it.
#[derive(Clone, Copy, Debug)]
pub(super) struct StoredTriangle {
    pub(super) corners: [Vec3; 3],
    pub(super) tag: Tag,
    pub(super) triangle: u32,
}

/// Four triangles. Unused lanes have NaN corners, which no ray meets.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
pub(super) struct Tri4 {
    /// Corner, axis, lane.
    pub(super) corners: [[[f32; 4]; 3]; 3],
    pub(super) tag: [Tag; 4],
    pub(super) triangle: [u32; 4],
}

impl Tri4 {
    pub(super) const LANES: usize = 4;

    /// The block of up to four triangles.
    pub(super) fn new(triangles: impl IntoIterator<Item = StoredTriangle>) -> Self {
        let mut block = Self { corners: [[[f32::NAN; 4]; 3]; 3], tag: [Tag(0); 4], triangle: [u32::MAX; 4] };
        for (lane, t) in triangles.into_iter().take(Self::LANES).enumerate() {
            for (rows, corner) in block.corners.iter_mut().zip(t.corners) {
                for axis in 0..3 {
                    rows[axis][lane] = corner[axis];
                }
            }
            block.tag[lane] = t.tag;
            block.triangle[lane] = t.triangle;
        }
        block
    }

    /// Box of the triangles.
    fn bounds(&self) -> Bounds {
        let points = (0..Self::LANES).flat_map(|lane| self.corners_of(lane)).filter(|p| p.is_finite());
        Bounds::of_points(points)
    }

    fn corners_of(&self, lane: usize) -> [Vec3; 3] {
        self.corners.map(|rows| Vec3::from_array(rows.map(|row| row[lane])))
    }

    /// Unnormalised normal of the winding, `(b − a) × (c − a)`.
    pub(super) fn winding_normal(&self, lane: usize) -> Vec3 {
        let [a, b, c] = self.corners_of(lane);
        (b - a).cross(c - a)
    }
}
