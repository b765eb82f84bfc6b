//! A fingerprint of the input: two lightmaps with the same one come from the same scene.

use crate::document::Document;
use std::fs;

/// Fingerprint of a document, its buffers and the files that it refers to, as 32 hexadecimal digits. It tells
/// versions of a scene apart; it does not withstand forgery.
pub fn scene_hash(document: &Document) -> String {
    let mut hash = Fnv::default();
    hash.part(document.json.to_string().as_bytes());
    for buffer in &document.buffers {
        hash.part(buffer);
    }
    for file in &document.external_files {
        // A missing file is a fact about the scene as well.
        hash.part(&fs::read(&file.path).unwrap_or_default());
    }
    hash.hex()
}

/// FNV-1a with 128 bits (Fowler, Noll, Vo; draft-eastlake-fnv).
pub(super) struct Fnv(u128);

impl Default for Fnv {
    fn default() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }
}

impl Fnv {
    const PRIME: u128 = (1 << 88) + (1 << 8) + 0x3b;

    /// Adds bytes.
    pub(super) fn update(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u128::from(b)).wrapping_mul(Self::PRIME);
        }
    }

    /// What it comes to, as 32 hexadecimal digits.
    pub(super) fn hex(&self) -> String {
        format!("{:032x}", self.0)
    }

    /// A run of bytes and its length, so that bytes cannot move from one part to the next unnoticed.
    pub(super) fn part(&mut self, bytes: &[u8]) {
        self.update(&(bytes.len() as u64).to_le_bytes());
        self.update(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_published_vectors() {
        let check = |text: &str, expected: u128| {
            let mut hash = Fnv::default();
            hash.update(text.as_bytes());
            assert_eq!(hash.0, expected, "{text}");
        };
        check("", 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d);
        check("a", 0xd228_cb69_6f1a_8caf_7891_2b70_4e4a_8964);
        check("foobar", 0x343e_1662_793c_64bf_6f0d_3597_ba44_6f18);
    }

    #[test]
    fn buffers_are_part_of_it() {
        let document =
            |bytes: &[&[u8]]| Document { buffers: bytes.iter().map(|b| b.to_vec()).collect(), ..Document::default() };
        let a = scene_hash(&document(&[b"ab", b"c"]));
        assert_eq!(a, scene_hash(&document(&[b"ab", b"c"])));
        assert_ne!(a, scene_hash(&document(&[b"a", b"bc"])));
    }
}
