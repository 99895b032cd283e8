"""Pictures and pages a person looks at: one HTML file each, without network."""
