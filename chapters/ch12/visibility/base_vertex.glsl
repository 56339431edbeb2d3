// The vertex offset of the draw command of this vertex.

#if BACKEND_VULKAN
#define BASE_VERTEX gl_BaseVertex
#else
#define BASE_VERTEX gl_BaseVertexARB
#endif
