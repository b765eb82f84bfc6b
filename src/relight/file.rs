//! `solution.lk`: a header, then sections in a fixed order, each compressed and with a checksum.
//!
//! ```text
//! "LKSOLVE\n"  version u32
//! HEAD         what the solution says about itself, JSON
//! PTCH         patches and the rays between them
//! PAGE …       per page: which texels are stored
//! GRUP …       per light group and page: irradiance, share that is direct
//! END
//! ```
//! A section is its name, the length of its content, its length in the file, the CRC-32 of what is in the file, and that.
//! Numbers are little-endian.

use super::records::{
    decode_group_page, decode_layout, decode_patches, encode_group_page, encode_layout, encode_patches,
};
use super::{GroupPage, Header, PageLayout, Patches};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use std::io::{self, ErrorKind, Read, Write};
use thiserror::Error;

/// Version of the format. A reader takes no other.
pub const VERSION: u32 = 1;

const MAGIC: &[u8; 8] = b"LKSOLVE\n";

type Tag = &'static [u8; 4];
const HEAD: Tag = b"HEAD";
const PTCH: Tag = b"PTCH";
const PAGE: Tag = b"PAGE";
const GRUP: Tag = b"GRUP";
const END: Tag = b"END ";

/// Why a solution cannot be used.
#[derive(Debug, Error)]
pub enum SolutionError {
    /// It cannot be read at all.
    #[error("the solution cannot be read")]
    Io(#[from] io::Error),
    /// Something else under its name.
    #[error("it is no solution of Lightkiln; bake the scene again with --groups")]
    Foreign,
    /// Written by another version of the format.
    #[error(
        "it has version {0} of the format, and this Lightkiln reads version {VERSION}; bake the scene again with --groups"
    )]
    Version(u32),
    /// It ends too early.
    #[error("it ends too early: the file is truncated; bake the scene again with --groups")]
    Truncated,
    /// A checksum or a number in it is wrong.
    #[error("its part {0} is corrupted; bake the scene again with --groups")]
    Corrupted(String),
}

/// Assembles a solution in memory, in the order of the format.
pub struct SolutionWriter {
    bytes: Vec<u8>,
}

impl SolutionWriter {
    /// Begins with the header and the patches.
    pub fn new(header: &Header, patches: &Patches) -> Self {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        let mut writer = Self { bytes };
        writer.section(HEAD, &serde_json::to_vec(header).expect("strings and numbers are valid JSON"));
        writer.section(PTCH, &encode_patches(patches));
        writer
    }

    /// Adds the layout of the next page.
    pub fn page(&mut self, layout: &PageLayout) {
        self.section(PAGE, &encode_layout(layout));
    }

    /// Adds the next page of the next group.
    pub fn group_page(&mut self, page: &GroupPage) {
        self.section(GRUP, &encode_group_page(page));
    }

    /// The whole file.
    pub fn finish(mut self) -> Vec<u8> {
        self.section(END, &[]);
        self.bytes
    }

    fn section(&mut self, tag: Tag, content: &[u8]) {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(4));
        let stored = encoder.write_all(content).and_then(|()| encoder.finish()).expect("memory takes everything");
        self.bytes.extend(tag);
        self.bytes.extend((content.len() as u64).to_le_bytes());
        self.bytes.extend((stored.len() as u64).to_le_bytes());
        self.bytes.extend(checksum(&stored).to_le_bytes());
        self.bytes.extend(stored);
    }
}

/// Reads a solution front to back, holding one section at a time.
pub struct SolutionReader<R> {
    source: R,
    /// What it says about itself.
    pub header: Header,
    /// Its patches.
    pub patches: Patches,
}

impl<R: Read> SolutionReader<R> {
    /// Reads header and patches.
    pub fn open(mut source: R) -> Result<Self, SolutionError> {
        let mut start = [0; MAGIC.len()];
        match read_exact(&mut source, &mut start) {
            Err(SolutionError::Truncated) => return Err(SolutionError::Foreign),
            other => other?,
        }
        if start != *MAGIC {
            return Err(SolutionError::Foreign);
        }
        let version = u32::from_le_bytes(read_array(&mut source)?);
        if version != VERSION {
            return Err(SolutionError::Version(version));
        }
        let head = section(&mut source, HEAD)?;
        let header: Header = serde_json::from_slice(&head).map_err(|_| corrupted(HEAD))?;
        let content = section(&mut source, PTCH)?;
        let patches = decode_patches(&content, &header).ok_or_else(|| corrupted(PTCH))?;
        Ok(Self { source, header, patches })
    }

    /// The layout of the next page.
    pub fn page(&mut self) -> Result<PageLayout, SolutionError> {
        let content = section(&mut self.source, PAGE)?;
        let layout = decode_layout(&content).ok_or_else(|| corrupted(PAGE))?;
        let materials = self.header.known.materials.len();
        let sound = layout.is_sound(self.patches.len()) && layout.material.iter().all(|&m| (m as usize) < materials);
        if sound { Ok(layout) } else { Err(corrupted(PAGE)) }
    }

    /// The next page of the next group, with that layout.
    pub fn group_page(&mut self, layout: &PageLayout) -> Result<GroupPage, SolutionError> {
        let content = section(&mut self.source, GRUP)?;
        decode_group_page(&content, layout.places.len()).ok_or_else(|| corrupted(GRUP))
    }

    /// Makes sure that this was all.
    pub fn finish(mut self) -> Result<(), SolutionError> {
        section(&mut self.source, END).map(|_| ())
    }
}

fn corrupted(tag: Tag) -> SolutionError {
    SolutionError::Corrupted(String::from_utf8_lossy(tag).trim().to_owned())
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

fn read_exact(source: &mut impl Read, into: &mut [u8]) -> Result<(), SolutionError> {
    source.read_exact(into).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => SolutionError::Truncated,
        _ => SolutionError::Io(e),
    })
}

fn read_array<const N: usize>(source: &mut impl Read) -> Result<[u8; N], SolutionError> {
    let mut bytes = [0; N];
    read_exact(source, &mut bytes)?;
    Ok(bytes)
}

/// The content of the next section, which must have that name.
fn section(source: &mut impl Read, tag: Tag) -> Result<Vec<u8>, SolutionError> {
    if read_array::<4>(source)? != *tag {
        return Err(corrupted(tag));
    }
    let length = u64::from_le_bytes(read_array(source)?);
    let stored_length = u64::from_le_bytes(read_array(source)?);
    let sum = u32::from_le_bytes(read_array(source)?);
    // Lengths may be wrong: memory is taken for what is there only.
    let mut stored = Vec::new();
    source.take(stored_length).read_to_end(&mut stored)?;
    if (stored.len() as u64) < stored_length {
        return Err(SolutionError::Truncated);
    }
    if checksum(&stored) != sum {
        return Err(corrupted(tag));
    }
    let mut content = Vec::new();
    let read = ZlibDecoder::new(&stored[..]).take(length.saturating_add(1)).read_to_end(&mut content);
    match read {
        Ok(n) if n as u64 == length => Ok(content),
        _ => Err(corrupted(tag)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Known, KnownGroup, KnownMaterial, Reflector};
    use super::*;
    use crate::gather::{Grouped, NOTHING};
    use crate::scene::Rgb;
    use crate::units::Quantity;
    use half::f16;
    use serde_json::Value;

    fn written() -> Vec<u8> {
        let known = Known {
            groups: vec![KnownGroup { name: "Key".into(), color: None }],
            materials: vec![KnownMaterial { name: "Wall".into(), reflectance: [0.5; 3] }],
            ..Known::default()
        };
        let header = Header {
            version: "0".into(),
            scene_hash: "abc".into(),
            report: Value::Null,
            settings: Value::Null,
            lit_scene: "a.lit.glb".into(),
            quantity: Quantity::Irradiance,
            rings: 2,
            known,
        };
        let mut writer = SolutionWriter::new(&header, &patches());
        writer.page(&layout());
        writer.group_page(&group_page());
        writer.finish()
    }

    fn patches() -> Patches {
        Patches {
            reflectors: vec![Reflector { patch: 0, material: 0, reflectance: Rgb::splat(0.5) }],
            first_ray: vec![0, 2],
            rays: vec![0, NOTHING],
            own: Grouped::from_groups(&[vec![Rgb::ONE]]),
            direct: Grouped::from_groups(&[vec![Rgb::splat(2.0)]]),
        }
    }

    fn layout() -> PageLayout {
        let (places, valid) = (vec![1, 2, 5], vec![true, true, false]);
        PageLayout { width: 3, height: 2, places, valid, chart: vec![0; 3], patch: vec![0; 3], ..PageLayout::default() }
    }

    fn group_page() -> GroupPage {
        let irradiance = [1.0, 2.5, 0.125].map(|v| [f16::from_f32(v); 3]).to_vec();
        GroupPage { irradiance, direct: vec![[0, 128, 255]; 3] }
    }

    fn read(bytes: &[u8]) -> Result<(Patches, PageLayout, GroupPage), SolutionError> {
        let mut reader = SolutionReader::open(bytes)?;
        let layout = reader.page()?;
        let group = reader.group_page(&layout)?;
        let patches = reader.patches.clone();
        reader.finish()?;
        Ok((patches, layout, group))
    }

    #[test]
    fn what_is_written_comes_back() {
        let (p, l, g) = read(&written()).expect("it is whole");
        assert_eq!((p, l, g), (patches(), layout(), group_page()));
    }

    #[test]
    fn every_cut_is_noticed() {
        let bytes = written();
        for end in 0..bytes.len() {
            let error = read(&bytes[..end]).expect_err("it is cut");
            let expected = if end < MAGIC.len() { "Foreign" } else { "Truncated" };
            assert!(format!("{error:?}").starts_with(expected), "{end}: {error:?}");
        }
    }

    #[test]
    fn every_changed_byte_is_noticed() {
        let bytes = written();
        for i in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[i] ^= 0x41;
            assert!(read(&changed).is_err(), "byte {i}");
        }
    }

    #[test]
    fn other_files_and_versions_are_named() {
        assert!(matches!(read(b"glTF and more than eight bytes"), Err(SolutionError::Foreign)));
        let mut older = written();
        older[MAGIC.len()] = 0;
        assert!(matches!(read(&older), Err(SolutionError::Version(0))));
    }
}
