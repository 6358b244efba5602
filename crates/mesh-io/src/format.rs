//! The formats and their names.

/// A mesh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Polygon File Format (Stanford), ASCII or binary.
    Ply,
    /// glTF 2.0, binary container.
    Glb,
    /// Draco.
    Drc,
    /// Steadymesh's own: a bincode envelope and raw arrays.
    Native,
}

/// Format, file extension, and content types, the first of which is preferred.
const NAMES: [(Format, &str, &[&str]); 5] = [
    (Format::Obj, "obj", &["model/obj"]),
    (Format::Ply, "ply", &["model/ply", "application/x-ply"]),
    (Format::Glb, "glb", &["model/gltf-binary"]),
    (Format::Drc, "drc", &["application/vnd.draco"]),
    (
        Format::Native,
        "smf",
        &[steadymesh_proto::NATIVE_CONTENT_TYPE],
    ),
];

impl Format {
    /// The format of files with this extension, without the dot, in any case.
    #[must_use]
    pub fn from_extension(extension: &str) -> Option<Self> {
        let is_named = |(_, name, _): &&(Self, &str, &[&str])| extension.eq_ignore_ascii_case(name);
        NAMES.iter().find(is_named).map(|row| row.0)
    }

    /// The file extension, without the dot.
    #[must_use]
    pub fn extension(self) -> &'static str {
        self.names().1
    }

    /// The format of a media type; parameters such as `; charset=utf-8` are ignored.
    #[must_use]
    pub fn from_content_type(content_type: &str) -> Option<Self> {
        let essence = content_type.split(';').next().unwrap_or_default().trim();
        NAMES
            .iter()
            .find(|row| row.2.iter().any(|name| essence.eq_ignore_ascii_case(name)))
            .map(|row| row.0)
    }

    /// The media type.
    #[must_use]
    pub fn content_type(self) -> &'static str {
        self.names().2[0]
    }

    fn names(self) -> &'static (Self, &'static str, &'static [&'static str]) {
        match self {
            Self::Obj => &NAMES[0],
            Self::Ply => &NAMES[1],
            Self::Glb => &NAMES[2],
            Self::Drc => &NAMES[3],
            Self::Native => &NAMES[4],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_found_again_by_each_of_its_names() {
        for (format, extension, content_types) in NAMES {
            assert_eq!(format.extension(), extension);
            assert_eq!(
                Format::from_extension(&extension.to_uppercase()),
                Some(format)
            );
            assert_eq!(format.content_type(), content_types[0]);
            for name in content_types {
                let with_parameter = format!(" {name} ; charset=utf-8");
                assert_eq!(Format::from_content_type(&with_parameter), Some(format));
            }
        }
        assert_eq!(Format::from_extension("stl"), None);
        assert_eq!(Format::from_content_type("application/octet-stream"), None);
    }
}
