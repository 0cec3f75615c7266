"""From photographs, or a film, to their cameras: structure from motion by COLMAP, in stages that resume."""
