//! Renderer client: a CPU tile rasteriser over the shared frame, PNG and MP4 out.
