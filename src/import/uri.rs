//! URIs of buffers and images: data URIs are decoded, everything else names a file beside the document.

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::path::{Path, PathBuf};

/// What a URI refers to.
pub(super) enum Resource {
    /// Content of a data URI.
    Inline(Vec<u8>),
    /// A file.
    File(PathBuf),
}

/// Resolves `uri` against the document's folder. Fails with the reason if a data URI is malformed or if the scheme is
/// one that would need a network.
pub(super) fn resolve(uri: &str, directory: &Path) -> Result<Resource, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (head, body) = data.split_once(',').ok_or("the data URI has no comma")?;
        return if head.ends_with(";base64") {
            decode_base64(body).map(Resource::Inline)
        } else {
            Ok(Resource::Inline(decode_percent(body)))
        };
    }
    let name = match uri.split_once("://") {
        Some(("file", name)) => name,
        Some((scheme, _)) => return Err(format!("`{scheme}:` addresses are not fetched")),
        None => uri,
    };
    let name = String::from_utf8(decode_percent(name)).map_err(|_| "the file name is not UTF-8")?;
    let path = directory.join(&name);
    // Some exporters write names unescaped, percent signs and all.
    let literal = directory.join(uri);
    Ok(Resource::File(if !path.exists() && literal.exists() { literal } else { path }))
}

/// Bytes of text with `%20`-like escapes; a malformed escape stands for itself.
fn decode_percent(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).and_then(|b| (*b as char).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        match (bytes[i], digit(i + 1), digit(i + 2)) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                i += 3;
            }
            (byte, ..) => {
                out.push(byte);
                i += 1;
            }
        }
    }
    out
}

/// As lenient as browsers and exporters are: padding may be missing, unused bits need not be zero.
const LENIENT: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Base64 in either alphabet; line breaks may be missing or present.
fn decode_base64(text: &str) -> Result<Vec<u8>, String> {
    let standard = |byte: u8| match byte {
        b'-' => b'+',
        b'_' => b'/',
        other => other,
    };
    let text: Vec<u8> = text.bytes().filter(|b| !b.is_ascii_whitespace()).map(standard).collect();
    LENIENT.decode(text).map_err(|e| format!("the base64 data is broken: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_may_lack_padding_be_broken_into_lines_and_use_either_alphabet() {
        let check = |text: &str, expected: &[u8]| assert_eq!(decode_base64(text), Ok(expected.into()));
        check("", b"");
        check("Zg==", b"f");
        check("Zm8", b"fo");
        check("Zm9v\nYm\r\n Fy", b"foobar");
        check("+/-_", &[0xfb, 0xff, 0xbf]);
        assert!(decode_base64("Zm9*").is_err());
        assert!(decode_base64("Zm9vY").is_err());
    }

    #[test]
    fn percent_escapes_are_decoded_and_malformed_ones_kept() {
        assert_eq!(decode_percent("a%20b%2"), b"a b%2");
        assert_eq!(decode_percent("100%"), b"100%");
    }

    #[test]
    fn network_addresses_are_refused() {
        assert!(resolve("https://example.org/a.bin", Path::new(".")).is_err());
    }
}
