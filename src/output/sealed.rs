//! Files that a bake writes for another bake: a line of JSON says what the file belongs to, its content follows in the
//! postcard format, and at the end stand the length and the CRC-32 of all before, little-endian.
//!
//! One of which a bit is wrong is refused: what it holds would end up in a lightmap unseen.

use super::files::{self, OutputError, Sink};
use super::identity::Fnv;
use crc32fast::Hasher;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

/// Bytes of the length and the checksum at the end.
const TRAILER: usize = 12;

/// Why such a file cannot be used.
#[derive(Debug)]
pub(super) enum Unsound {
    /// It cannot be read.
    Read(io::Error),
    /// It is not what was written.
    Damaged,
}

/// A file that is whole.
pub(super) struct Sealed {
    bytes: Vec<u8>,
    /// First byte of the head, of the content, and after it.
    parts: [usize; 3],
}

impl Sealed {
    /// The line of JSON.
    pub(super) fn head<T: DeserializeOwned>(&self) -> Result<T, Unsound> {
        serde_json::from_slice(&self.bytes[self.parts[0]..self.parts[1] - 1]).map_err(|_| Unsound::Damaged)
    }

    /// What follows.
    pub(super) fn content<T: DeserializeOwned>(&self) -> Result<T, Unsound> {
        postcard::from_bytes(self.content_bytes()).map_err(|_| Unsound::Damaged)
    }

    /// The same as it stands in the file.
    pub(super) fn content_bytes(&self) -> &[u8] {
        &self.bytes[self.parts[1]..self.parts[2]]
    }
}

/// Writes a file whole in place of an earlier one. `magic` is what its first line begins with.
pub(super) fn write(
    path: &Path,
    magic: &str,
    head: &impl Serialize,
    content: &impl Serialize,
) -> Result<(), OutputError> {
    files::replace(path, |sink| seal(sink, magic, head, content))
}

fn seal(sink: &mut dyn Sink, magic: &str, head: &impl Serialize, content: &impl Serialize) -> io::Result<()> {
    let mut sum = Summed { sink, hasher: Hasher::new(), length: 0 };
    writeln!(sum, "{magic}{}", serde_json::to_string(head)?)?;
    // Postcard keeps what the system said to itself.
    postcard::to_io(content, &mut sum).map_err(|_| io::Error::other("the disk takes no more"))?;
    let (length, crc) = (sum.length, sum.hasher.finalize());
    sink.write_all(&length.to_le_bytes())?;
    sink.write_all(&crc.to_le_bytes())
}

/// Reads a file, none if there is none.
pub(super) fn read(path: &Path, magic: &str) -> Result<Option<Sealed>, Unsound> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(None),
        Err(source) => return Err(Unsound::Read(source)),
    };
    let parts = parts(&bytes, magic).ok_or(Unsound::Damaged)?;
    Ok(Some(Sealed { bytes, parts }))
}

/// Where head and content lie, if the file is whole.
fn parts(bytes: &[u8], magic: &str) -> Option<[usize; 3]> {
    let end = bytes.len().checked_sub(TRAILER)?;
    let (body, trailer) = bytes.split_at(end);
    let (length, crc) = trailer.split_at(8);
    if length != (end as u64).to_le_bytes() || crc != crc32fast::hash(body).to_le_bytes() {
        return None;
    }
    let line = body.iter().position(|&b| b == b'\n')?;
    body[..line].starts_with(magic.as_bytes()).then_some([magic.len(), line + 1, end])
}

/// Adds what `content` comes to in a file to a fingerprint.
pub(super) fn fingerprint(hash: &mut Fnv, content: &impl Serialize) {
    struct Hashed<'a>(&'a mut Fnv);
    impl Write for Hashed<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.update(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    postcard::to_io(content, Hashed(hash)).expect("every type that is kept has a form in postcard");
}

/// Counts and sums what goes to a file.
struct Summed<'a, W: Write + ?Sized> {
    sink: &'a mut W,
    hasher: Hasher,
    length: u64,
}

impl<W: Write + ?Sized> Write for Summed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.sink.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        self.length += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}
