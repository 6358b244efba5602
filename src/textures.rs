//! The images that come with frames: as they came, and as they are delivered.

use std::fmt::Write as _;
use std::io::Cursor;
use std::sync::Arc;

use bytes::Bytes;
use futures_util::FutureExt;
use futures_util::future::{BoxFuture, Shared, ready};
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageReader};
use sha2::{Digest, Sha256};
use steadymesh_mesh_io::{Image, ImageBytes, ImageFormat, ImageInfo};
use steadymesh_proto::metrics;
use steadymesh_proto::stream::TextureFormat;

use crate::compute::{ComputePool, JobPanicked, Length};

/// What a decoder may take: an image of 8,192 x 8,192 pixels.
const MAX_DECODED_BYTES: u64 = 512 << 20;

/// What becomes of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextureSettings {
    /// In which format they are delivered.
    pub format: TextureFormat,
    /// The quality of a JPEG that is made here, 1 to 100.
    pub quality: u8,
    /// The largest width and height, in pixels.
    pub max_size: Option<u32>,
}

impl Default for TextureSettings {
    /// As they came.
    fn default() -> Self {
        Self {
            format: TextureFormat::Original,
            quality: 85,
            max_size: None,
        }
    }
}

/// An image as it came. Copies share the bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceImage {
    info: ImageInfo,
    bytes: Bytes,
}

impl SourceImage {
    /// Takes the image of a mesh that was read from `body`, whose bytes are not kept by it.
    #[must_use]
    pub fn new(image: &Image, body: &[u8]) -> Self {
        let bytes = match &image.bytes {
            ImageBytes::Within(range) => &body[range.clone()],
            ImageBytes::Own(bytes) => bytes,
        };
        Self {
            info: image.info,
            bytes: Bytes::copy_from_slice(bytes),
        }
    }

    /// The file, and which format it has.
    #[must_use]
    pub fn file(&self) -> (ImageFormat, &Bytes) {
        (self.info.format, &self.bytes)
    }
}

/// An image as it is delivered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texture {
    /// What is said of it.
    pub figures: metrics::Texture,
    /// The file.
    pub bytes: Bytes,
}

/// What became of an image: none if none is delivered, or why it cannot be.
pub type Made = Result<Option<Arc<Texture>>, Arc<str>>;

/// What becomes of an image, once it is known.
pub type Making = Shared<BoxFuture<'static, Made>>;

/// The newest image of a stream.
#[derive(Debug, Clone)]
pub struct Newest {
    source: SourceImage,
    settings: TextureSettings,
    making: Making,
}

impl Newest {
    /// What becomes of it.
    pub fn making(&self) -> Making {
        self.making.clone()
    }
}

/// Begins to make what is delivered of a frame's image, on the pool. One that is the same as the
/// frame's before becomes the same.
#[must_use]
pub fn begin(
    pool: &Arc<ComputePool>,
    source: SourceImage,
    settings: TextureSettings,
    before: Option<Newest>,
) -> Newest {
    let making = if settings.format == TextureFormat::None {
        ready(Ok(None)).boxed()
    } else {
        let (pool, source) = (Arc::clone(pool), source.clone());
        let before = before.filter(|before| before.settings == settings);
        async move { make_or_reuse(pool, source, settings, before).await }.boxed()
    };
    Newest {
        source,
        settings,
        making: making.shared(),
    }
}

async fn make_or_reuse(
    pool: Arc<ComputePool>,
    source: SourceImage,
    settings: TextureSettings,
    before: Option<Newest>,
) -> Made {
    if let Some(before) = before {
        let (one, other) = (source.clone(), before.source);
        let is_same = pool.run(Length::Short, move || one == other).await;
        if is_same == Ok(true) {
            return before.making.await;
        }
    }
    let job = move || make(&source, &settings);
    let made = pool.run(Length::Long, job).await;
    made.unwrap_or_else(|JobPanicked| Err("a defect of the server".into()))
}

/// Makes what is delivered of an image.
///
/// # Errors
///
/// Why it cannot be decoded, for people.
pub fn make(source: &SourceImage, settings: &TextureSettings) -> Made {
    let info = source.info;
    let has_room = settings
        .max_size
        .is_none_or(|most| info.width <= most && info.height <= most);
    let stays = match settings.format {
        TextureFormat::None => return Ok(None),
        TextureFormat::Original => has_room,
        TextureFormat::Jpeg => has_room && info.format == ImageFormat::Jpeg,
    };
    let decoder = match info.format {
        ImageFormat::Jpeg => image::ImageFormat::Jpeg,
        ImageFormat::Png => image::ImageFormat::Png,
        ImageFormat::Webp => image::ImageFormat::WebP,
        // These are made by rigs that know what their players take.
        _ => return Ok(Some(texture(info, source.bytes.clone(), false))),
    };
    if stays {
        return Ok(Some(texture(info, source.bytes.clone(), false)));
    }
    let name = info.format.media_type();
    let failed = |error: image::ImageError| -> Arc<str> { format!("{name}: {error}").into() };
    let mut image = decode(&source.bytes, decoder).map_err(failed)?;
    if let Some(most) = settings.max_size.filter(|_| !has_room) {
        image = image.thumbnail(most, most);
    }
    let keeps_png = settings.format == TextureFormat::Original && info.format == ImageFormat::Png;
    let (format, bytes) = if keeps_png {
        (ImageFormat::Png, encode_png(&image))
    } else {
        (ImageFormat::Jpeg, encode_jpeg(&image, settings.quality))
    };
    let info = ImageInfo {
        format,
        width: image.width(),
        height: image.height(),
    };
    Ok(Some(texture(info, bytes.map_err(failed)?.into(), true)))
}

fn decode(bytes: &[u8], format: image::ImageFormat) -> Result<DynamicImage, image::ImageError> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    reader.limits(limits);
    reader.decode()
}

fn encode_jpeg(image: &DynamicImage, quality: u8) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    image.to_rgb8().write_with_encoder(encoder)?;
    Ok(bytes)
}

fn encode_png(image: &DynamicImage) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn texture(info: ImageInfo, bytes: Bytes, encoded: bool) -> Arc<Texture> {
    let digest = Sha256::digest(&bytes);
    let mut id = String::with_capacity(32);
    for byte in &digest[..16] {
        // A string takes everything.
        write!(id, "{byte:02x}").ok();
    }
    let figures = metrics::Texture {
        id,
        media_type: info.format.media_type().to_owned(),
        bytes: bytes.len(),
        width: info.width,
        height: info.height,
        encoded,
    };
    Arc::new(Texture { figures, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(width: u32, height: u32, format: ImageFormat) -> SourceImage {
        let image = image::RgbImage::from_fn(width, height, |x, y| {
            image::Rgb([(x * 3) as u8, (y * 5) as u8, 90])
        });
        let image = DynamicImage::from(image);
        let bytes = match format {
            ImageFormat::Png => encode_png(&image).unwrap(),
            _ => encode_jpeg(&image, 90).unwrap(),
        };
        SourceImage {
            info: ImageInfo::read(&bytes).unwrap(),
            bytes: bytes.into(),
        }
    }

    fn made(source: &SourceImage, format: TextureFormat, max_size: Option<u32>) -> Arc<Texture> {
        let settings = TextureSettings {
            format,
            max_size,
            ..TextureSettings::default()
        };
        make(source, &settings).unwrap().unwrap()
    }

    #[test]
    fn an_image_is_delivered_as_it_came_unless_something_else_is_asked_for() {
        let png = source(64, 32, ImageFormat::Png);
        for max_size in [None, Some(64)] {
            let texture = made(&png, TextureFormat::Original, max_size);
            assert_eq!(texture.bytes, png.bytes);
            assert!(!texture.figures.encoded);
            assert_eq!(texture.figures.id.len(), 32);
        }
        let jpeg = source(64, 32, ImageFormat::Jpeg);
        assert_eq!(made(&jpeg, TextureFormat::Jpeg, None).bytes, jpeg.bytes);
        let none = TextureSettings {
            format: TextureFormat::None,
            ..TextureSettings::default()
        };
        assert_eq!(make(&png, &none), Ok(None));
    }

    #[test]
    fn an_image_is_made_smaller_and_a_jpeg() {
        let png = source(64, 32, ImageFormat::Png);
        for (format, max_size, expected) in [
            (TextureFormat::Jpeg, None, (ImageFormat::Jpeg, 64, 32)),
            (TextureFormat::Jpeg, Some(16), (ImageFormat::Jpeg, 16, 8)),
            (TextureFormat::Original, Some(16), (ImageFormat::Png, 16, 8)),
        ] {
            let texture = made(&png, format, max_size);
            let info = ImageInfo::read(&texture.bytes).unwrap();
            assert_eq!((info.format, info.width, info.height), expected);
            let figures = &texture.figures;
            assert_eq!((figures.width, figures.height), (info.width, info.height));
            assert_eq!(figures.media_type, info.format.media_type());
            assert!(figures.encoded);
        }
    }

    #[test]
    fn the_name_of_an_image_is_that_of_its_bytes() {
        let id = |source: &SourceImage| {
            made(source, TextureFormat::Original, None)
                .figures
                .id
                .clone()
        };
        let (one, other) = (
            source(8, 8, ImageFormat::Png),
            source(8, 9, ImageFormat::Png),
        );
        assert_eq!(id(&one), id(&one.clone()));
        assert_ne!(id(&one), id(&other));
    }

    #[test]
    fn an_image_that_cannot_be_decoded_says_so_and_only_when_it_has_to_be() {
        let png = source(64, 32, ImageFormat::Png);
        let cut = SourceImage {
            bytes: png.bytes.slice(..40),
            ..png
        };
        assert_eq!(made(&cut, TextureFormat::Original, None).bytes, cut.bytes);
        let settings = TextureSettings {
            format: TextureFormat::Jpeg,
            ..TextureSettings::default()
        };
        let error = make(&cut, &settings).unwrap_err();
        assert!(error.starts_with("image/png: "), "{error}");
    }

    #[tokio::test]
    async fn the_same_image_again_is_not_made_again() {
        let pool = Arc::new(
            ComputePool::new(crate::compute::Options {
                threads: 1,
                queue: 8,
            })
            .unwrap(),
        );
        let png = source(64, 32, ImageFormat::Png);
        let settings = TextureSettings {
            format: TextureFormat::Jpeg,
            ..TextureSettings::default()
        };
        let first = begin(&pool, png.clone(), settings, None);
        let again = begin(&pool, png.clone(), settings, Some(first.clone()));
        let (one, two) = (first.making().await, again.making().await);
        let (one, two) = (one.unwrap().unwrap(), two.unwrap().unwrap());
        assert!(Arc::ptr_eq(&one, &two));
        let worse = TextureSettings {
            quality: 10,
            ..settings
        };
        let third = begin(&pool, png, worse, Some(again)).making().await;
        assert_ne!(third.unwrap().unwrap().bytes, one.bytes);
    }
}
