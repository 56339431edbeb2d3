"""Reference pictures: a chapter's scene, camera and settings, traced by paths until the estimated error is small."""
