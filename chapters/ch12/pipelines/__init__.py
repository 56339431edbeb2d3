"""From shaders to pipelines: layouts, descriptors, caches."""
