"""What all reports share: rows, pictures, pages, templates."""
