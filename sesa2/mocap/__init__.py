"""What motion capture systems export: who was where, and when."""
