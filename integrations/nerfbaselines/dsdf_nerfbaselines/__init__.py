"""dsdf as a method of nerfbaselines: ``spec`` registers it, ``method`` is the method."""
