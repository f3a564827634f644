//! What stands before the bytes of a picture that goes to a page.

/// How good a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quality {
    /// Drawn in time; better ones follow if the camera rests.
    Quick = 0,
    /// Between.
    Better = 1,
    /// As good as asked for.
    Full = 2,
}

/// What drew a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drawer {
    /// The scene itself.
    Scene = 0,
    /// The cloud that stands for a field.
    Cloud = 1,
    /// The scene above, the cloud below: a picture that is not finished.
    Both = 2,
}

/// What stands before the bytes of a picture, little endian, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Header {
    /// Of the request, `u32`.
    pub(crate) id: u32,
    /// Training steps of what is shown, `u32`.
    pub(crate) step: u32,
    /// Milliseconds to draw and encode it, `f32`.
    pub(crate) ms: f32,
    /// Depths that are drawn brightest and darkest, world units; of flow 0 and the length of the fullest colour, pixels of the best
    /// picture; 0 in other layers. Two `f32`.
    pub(crate) range: [f32; 2],
    /// Columns and rows, two `u16`.
    pub(crate) size: (u16, u16),
    /// One byte.
    pub(crate) quality: Quality,
    /// One byte; two more are 0.
    pub(crate) drawer: Drawer,
}

impl Header {
    pub(crate) const BYTES: usize = 28;

    /// The message: this header, and then the file.
    pub(crate) fn before(&self, file: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(Self::BYTES + file.len());
        out.extend(self.id.to_le_bytes());
        out.extend(self.step.to_le_bytes());
        out.extend(self.ms.to_le_bytes());
        out.extend(self.range[0].to_le_bytes());
        out.extend(self.range[1].to_le_bytes());
        out.extend(self.size.0.to_le_bytes());
        out.extend(self.size.1.to_le_bytes());
        out.extend([self.quality as u8, self.drawer as u8, 0, 0]);
        out.extend(file);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_has_its_fields_at_known_places() {
        let header = Header {
            id: 1,
            step: 300,
            ms: 2.5,
            range: [1.0, 4.0],
            size: (640, 480),
            quality: Quality::Full,
            drawer: Drawer::Both,
        };
        let bytes = header.before(b"file");
        assert_eq!(bytes.len(), Header::BYTES + 4);
        assert_eq!(bytes[..8], [1, 0, 0, 0, 44, 1, 0, 0]);
        assert_eq!(bytes[8..12], 2.5f32.to_le_bytes());
        assert_eq!(bytes[20..28], [128, 2, 224, 1, 2, 2, 0, 0]);
        assert_eq!(&bytes[28..], b"file");
    }
}
