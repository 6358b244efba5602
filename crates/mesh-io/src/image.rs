//! The images that lie on meshes: which format, and how large.

use std::ops::Range;

use imagesize::{Compression, ImageType};

use crate::ReadError;

/// The largest width or height that is taken: what graphics cards take.
pub const MAX_IMAGE_SIZE: u32 = 16_384;

/// An image file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum ImageFormat {
    /// JPEG.
    Jpeg,
    /// PNG.
    Png,
    /// WebP.
    Webp,
    /// AVIF: AV1 in HEIF.
    Avif,
    /// KTX 2.0: what graphics cards take as it is.
    Ktx2,
}

impl ImageFormat {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Jpeg, Self::Png, Self::Webp, Self::Avif, Self::Ktx2];

    /// The media type.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
            Self::Webp => "image/webp",
            Self::Avif => "image/avif",
            Self::Ktx2 => "image/ktx2",
        }
    }

    /// The file extension, without the dot.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Jpeg => "jpg",
            Self::Png => "png",
            Self::Webp => "webp",
            Self::Avif => "avif",
            Self::Ktx2 => "ktx2",
        }
    }

    /// The format of this media type.
    #[must_use]
    pub fn from_media_type(media_type: &str) -> Option<Self> {
        let mut all = Self::ALL.into_iter();
        all.find(|format| format.media_type().eq_ignore_ascii_case(media_type))
    }
}

/// What an image's header says of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageInfo {
    /// Its format.
    pub format: ImageFormat,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

impl ImageInfo {
    /// Reads an image's header. What follows it is not looked at.
    ///
    /// # Errors
    ///
    /// [`ReadError::Image`] if it has none of the known formats, ends early, or is larger than
    /// graphics cards take.
    pub fn read(bytes: &[u8]) -> Result<Self, ReadError> {
        let refused = |message: String| ReadError::Image { message };
        let format = match imagesize::image_type(bytes) {
            Ok(ImageType::Jpeg) => ImageFormat::Jpeg,
            Ok(ImageType::Png) => ImageFormat::Png,
            Ok(ImageType::Webp) => ImageFormat::Webp,
            Ok(ImageType::Heif(Compression::Av1)) => ImageFormat::Avif,
            Ok(ImageType::Ktx2) => ImageFormat::Ktx2,
            _ => {
                return Err(refused(
                    "it begins like none of JPEG, PNG, WebP, AVIF and KTX2".to_owned(),
                ));
            }
        };
        let size = imagesize::blob_size(bytes).map_err(|_| {
            let name = format.media_type();
            refused(format!("its header, of {name}, is cut off or damaged"))
        })?;
        let range = 1..=MAX_IMAGE_SIZE as usize;
        if !range.contains(&size.width) || !range.contains(&size.height) {
            return Err(refused(format!(
                "it has {} x {} pixels; width and height must be from 1 to {MAX_IMAGE_SIZE}",
                size.width, size.height
            )));
        }
        Ok(Self {
            format,
            // Both are in range.
            width: size.width as u32,
            height: size.height as u32,
        })
    }
}

/// Where an image's bytes are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ImageBytes {
    /// In the body that the mesh was read from.
    Within(Range<usize>),
    /// They had to be decoded.
    Own(Vec<u8>),
}

/// The image that comes with a mesh. Its format and size are known to be usable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// What its header says.
    pub info: ImageInfo,
    /// The file.
    pub bytes: ImageBytes,
}

impl Image {
    /// The image at `range` of `body`.
    ///
    /// # Errors
    ///
    /// [`ReadError::Image`].
    pub(crate) fn within(body: &[u8], range: Range<usize>) -> Result<Self, ReadError> {
        let info = ImageInfo::read(body.get(range.clone()).unwrap_or_default())?;
        let bytes = ImageBytes::Within(range);
        Ok(Self { info, bytes })
    }

    /// An image that stands alone.
    ///
    /// # Errors
    ///
    /// [`ReadError::Image`].
    pub fn new(bytes: Vec<u8>) -> Result<Self, ReadError> {
        let info = ImageInfo::read(&bytes)?;
        let bytes = ImageBytes::Own(bytes);
        Ok(Self { info, bytes })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The smallest PNG of this size as far as its header goes.
    pub(crate) fn png_header(width: u32, height: u32) -> Vec<u8> {
        let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
        png.extend(width.to_be_bytes());
        png.extend(height.to_be_bytes());
        png
    }

    #[test]
    fn formats_and_sizes_are_read_from_headers() {
        let mut ktx2 = b"\xabKTX 20\xbb\r\n\x1a\n\0\0\0\0\0\0\0\0".to_vec();
        ktx2.extend([8, 0, 0, 0, 4, 0, 0, 0]);
        let jpeg = b"\xff\xd8\xff\xe0\0\x04\0\0\xff\xc0\0\x11\x08\0\x04\0\x08\x03\x01\x22\0\x02\x11\x01\x03\x11\x01";
        let webp = b"RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f\x07\xc0\0\0\0\0\0\0";
        // ftyp; meta with iprp with ipco with ispe.
        let avif =
            b"\0\0\0\x14ftypavif\0\0\0\0mif1\0\0\0\x30meta\0\0\0\0\0\0\0\x24iprp\0\0\0\x1cipco\
                     \0\0\0\x14ispe\0\0\0\0\0\0\0\x08\0\0\0\x04";
        for (bytes, format) in [
            (avif.to_vec(), ImageFormat::Avif),
            (png_header(8, 4), ImageFormat::Png),
            (ktx2, ImageFormat::Ktx2),
            (jpeg.to_vec(), ImageFormat::Jpeg),
            (webp.to_vec(), ImageFormat::Webp),
        ] {
            let info = ImageInfo::read(&bytes).unwrap();
            assert_eq!((info.format, info.width, info.height), (format, 8, 4));
        }
    }

    #[test]
    fn what_is_no_image_or_too_large_a_one_is_refused() {
        let message = |bytes: &[u8]| ImageInfo::read(bytes).unwrap_err().to_string();
        assert!(message(b"").contains("begins like none"));
        assert!(message(b"GIF89a\x01\0\x01\0").contains("begins like none"));
        assert!(message(&png_header(8, 4)[..20]).contains("cut off"));
        assert!(message(&png_header(0, 4)).contains("0 x 4 pixels"));
        assert!(message(&png_header(8, 16_385)).contains("8 x 16385 pixels"));
    }

    #[test]
    fn every_media_type_is_found_again() {
        for format in ImageFormat::ALL {
            let found = ImageFormat::from_media_type(&format.media_type().to_uppercase());
            assert_eq!(found, Some(format));
        }
        assert_eq!(ImageFormat::from_media_type("image/gif"), None);
    }
}
