//! What the published tracker says of images that are known.
