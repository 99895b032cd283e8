"""The filters: from the unfiltered contact wrench to the one that is published."""
