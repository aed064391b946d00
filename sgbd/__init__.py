"""Zero-shot instance segmentation of cluttered RGB-D scenes on superpixel graphs."""
