"""From a record's frames to merged pictures and PSFs, and how pictures are judged."""
