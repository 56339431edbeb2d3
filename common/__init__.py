"""API-free foundation of Strata: scenes, transforms, cameras, images, metrics, statistics, lessons."""
