//! KTX2 textures of KHR_texture_basisu (ETC1S and UASTC) → RGBA.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

/// First bytes of every KTX2 file.
const MAGIC: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// True if the bytes are a KTX2 file.
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Width, height and texels of the largest mip level. Fails with the reason; `max_bytes` bounds the result.
pub(super) fn decode(bytes: &[u8], max_bytes: u64) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    let format = bytes.get(12..16).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
    if format != 0 {
        return Err(format!("it is a KTX2 file of Vulkan format {format}, not a Basis texture"));
    }
    check_sizes(bytes, max_bytes).ok_or("its header does not fit its content")?;
    let texture = Transcoder::new(bytes).map_err(|e| format!("{e:?}"))?;
    let (width, height) = texture.base_dimensions();
    if !texture.supports(TargetFormat::Rgba32) {
        return Err(format!("{:?} has no colours of 8 bits", texture.source_format()));
    }
    let pixels = texture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(|e| format!("{e:?}"))?;
    let texels = pixels.as_chunks::<4>().0.to_vec();
    if texels.len() != width as usize * height as usize || texels.is_empty() {
        return Err("it has no texels".into());
    }
    Ok((width, height, texels))
}

/// Requires sizes that a plain texture can have: the transcoder reserves what the header announces.
/// Offsets are those of the KTX 2.0 specification, section 3.
fn check_sizes(bytes: &[u8], max_bytes: u64) -> Option<()> {
    let word = |at: usize| Some(u64::from(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)));
    let long = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?));
    let (width, height) = (word(20)?, word(24)?);
    let (layers, faces, levels) = (word(32)?, word(36)?, word(40)?);
    let plain = layers <= 1 && faces == 1 && levels <= 32;
    if !plain || width * height * 4 > max_bytes {
        return None;
    }
    for level in 0..levels.max(1) as usize {
        let entry = 80 + 24 * level;
        let end = long(entry)?.checked_add(long(entry + 8)?)?;
        // UASTC has one byte per texel in blocks of 4 × 4, ETC1S less.
        let plain_bytes = width.next_multiple_of(4) * height.next_multiple_of(4);
        if end > bytes.len() as u64 || long(entry + 16)? > plain_bytes {
            return None;
        }
    }
    Some(())
}
