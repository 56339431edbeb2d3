"""What differs between the APIs, behind one interface for the renderer."""
